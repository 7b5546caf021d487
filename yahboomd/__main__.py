"""``python -m yahboomd``."""

from yahboomd.cli.main import main

if __name__ == "__main__":
    raise SystemExit(main())
