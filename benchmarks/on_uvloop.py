"""``yahboomd`` on uvloop's event loop: ``python -m benchmarks.on_uvloop run ...``."""

from __future__ import annotations

import asyncio
import sys

import uvloop

from yahboomd.cli.main import main

if __name__ == "__main__":
    asyncio.set_event_loop_policy(uvloop.EventLoopPolicy())
    sys.exit(main(sys.argv[1:]))
