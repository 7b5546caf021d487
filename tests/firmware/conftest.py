from __future__ import annotations

from collections.abc import Iterator

import pytest
from vendor_firmware import instead_of_simulated


@pytest.fixture
def vendors_image() -> Iterator[None]:
    with instead_of_simulated():
        yield
