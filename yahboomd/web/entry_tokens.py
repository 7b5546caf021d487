"""The tokens that give access to the page, and their cookies.

Two tokens, made once: the driver's and the viewer's. A page exchanges its token for a cookie
derived from it: a new token ends all sessions of the old one, a restart of the server ends none.
"""

from __future__ import annotations

import hashlib
import hmac
import os
import secrets
from pathlib import Path

import msgspec

from yahboomd.core.errors import ConfigError
from yahboomd.tools.whole_file import write_whole
from yahboomd.web.page_frames import Role

FILE = "web-tokens.json"

LARGEST_BYTES = 4096

ROLES: tuple[Role, ...] = ("driver", "viewer")


class Tokens(msgspec.Struct, frozen=True, kw_only=True):
    """The tokens of one robot, for people who drive and for people who watch."""

    driver: str
    viewer: str

    def of(self, role: Role) -> str:
        """The token of a role."""
        return self.driver if role == "driver" else self.viewer

    def role(self, token: str) -> Role | None:
        """The role of a token, compared in constant time; None for a wrong one."""
        return _matching({role: self.of(role) for role in ROLES}, token)

    def cookie(self, role: Role) -> str:
        """The cookie of a role."""
        key = self.of(role).encode()
        return hmac.new(key, f"yahboomd web {role}".encode(), hashlib.sha256).hexdigest()

    def role_of_cookie(self, cookie: str) -> Role | None:
        """The role of a cookie, compared in constant time; None for a wrong one."""
        return _matching({role: self.cookie(role) for role in ROLES}, cookie)


def keep(folder: Path, name: str, content: bytes) -> None:
    """Write a file that only its folder's owner can read, also if root writes it.

    An existing link is replaced, not followed: the service's user can write to that folder, and
    must not make root write elsewhere.

    Raises:
        OSError: The folder cannot be written to.
    """
    folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    its = folder.stat()
    owner = (its.st_uid, its.st_gid) if os.geteuid() == 0 else None
    write_whole(folder / name, content, mode=0o600, owner=owner)


def _matching(expected: dict[Role, str], given: str) -> Role | None:
    found: Role | None = None
    # Both are compared, so that the time does not show which one matched.
    for role, secret in expected.items():
        if hmac.compare_digest(secret.encode(), given.encode()):
            found = role
    return found


def read_tokens(folder: Path) -> Tokens | None:
    """The tokens in the state directory; None if there are none.

    Raises:
        ConfigError: The file cannot be used, or others may read it.
    """
    path = folder / FILE
    try:
        with path.open("rb") as file:
            if os.fstat(file.fileno()).st_mode & 0o077:
                raise ConfigError(
                    f"{path} can be read by other users: its tokens are no secret any more.",
                    remedy="Make new ones with `yahboomd web --new-tokens`.",
                )
            tokens = msgspec.json.decode(file.read(LARGEST_BYTES), type=Tokens)
    except FileNotFoundError:
        return None
    except PermissionError as error:
        raise ConfigError(
            f"{path} may not be read by this user.",
            remedy="If it belongs to the service: `sudo yahboomd web --show-link`.",
        ) from error
    except (OSError, ValueError) as error:
        raise ConfigError(
            f"{path} cannot be used: {error}.",
            remedy="Make new tokens with `yahboomd web --new-tokens`.",
        ) from error
    if min(len(tokens.driver), len(tokens.viewer)) < 16 or tokens.driver == tokens.viewer:
        raise ConfigError(
            f"The tokens in {path} are too short, or the same one.",
            remedy="Make new ones with `yahboomd web --new-tokens`.",
        )
    return tokens


def make_tokens(folder: Path) -> Tokens:
    """Make tokens, readable by this user only; older ones become invalid.

    Raises:
        ConfigError: The folder cannot be written to.
    """
    tokens = Tokens(driver=secrets.token_urlsafe(16), viewer=secrets.token_urlsafe(16))
    try:
        keep(folder, FILE, msgspec.json.encode(tokens))
    except OSError as error:
        raise ConfigError(
            f"The tokens cannot be kept in {folder}: {error.strerror}.",
            remedy="Set XDG_STATE_HOME to a folder that this user may write to.",
        ) from error
    return tokens
