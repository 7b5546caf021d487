"""`make page-figures`: CPU and memory of the page's server with 0, 1, 5 and 30 pages and with five
that look at a camera, and the bytes that a phone loads first.

A simulated board, the daemon and `yahboomd web` run as processes, with their default settings. One
page drives at 20 commands a second, the others watch, and all receive every message. The camera
sends 30 pictures of 40 kB a second; five pages without and with it are measured in turn.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import re
import secrets
import signal
import socket
import statistics
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path

from websockets.asyncio.client import connect

from benchmarks.rig import free_endpoint

PAGES = (0, 1, 5, 30)
SECONDS = 15.0
PERIOD_S = 0.05
GOALS = {1: "5 %"}
MEMORY_GOAL = "60 MB"
LOAD_GOAL = "200 kB"
LOOKING = 5
TURNS = 3
PICTURE_BYTES = 40_000
PICTURES_A_SECOND = 30


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n", maxsplit=1)[0])
    parser.add_argument("--seconds", type=float, default=SECONDS, help="to measure the CPU over")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="yahboomd-page-") as name:
        folder = Path(name)
        endpoint = free_endpoint()
        port = folder / "board"
        camera = socket.create_server(("127.0.0.1", 0))
        running = [_yahboomd("simulate", "--link", str(port))]
        try:
            while not port.exists():
                time.sleep(0.05)
            settings = [f'zenoh.listen=["{endpoint}"]', "zenoh.connect=[]"]
            settings += [f"estop.latch_file={folder / 'estop'}"]
            sets = [word for each in settings for word in ("--set", each)]
            running.append(_yahboomd("run", "--port", str(port), *sets))
            address = f"web.camera=http://127.0.0.1:{camera.getsockname()[1]}/stream"
            where = ("--listen", "127.0.0.1:0", "--connect", endpoint)
            web = _yahboomd("web", *where, "--set", address)
            running.append(web)
            asyncio.run(_measure(web, camera, args.seconds))
        finally:
            for each in reversed(running):
                each.send_signal(signal.SIGTERM)
                each.wait()
    return 0


async def _measure(web: subprocess.Popen[str], camera: socket.socket, seconds: float) -> None:
    assert web.stdout is not None
    found = re.search(r":(\d+)/", web.stdout.readline())
    assert found is not None
    where = f"127.0.0.1:{found[1]}"
    print("| pages | CPU, of a core | goal | memory | received by each page |")
    print("|---|---|---|---|---|")
    for count in PAGES:
        share, memory, rate = await _with(web, where, count, seconds)
        print(
            f"| {count} | {share * 100:.1f} % | {GOALS.get(count, '')} | "
            f"{memory / 1e6:.0f} MB | {rate:.0f} kB/s |",
            flush=True,
        )
    async with await asyncio.start_server(_send_pictures, sock=camera):
        ratios, memories, rates = [], [], []
        for _ in range(TURNS):
            without, _, _ = await _with(web, where, LOOKING, seconds)
            share, memory, rate = await _with(web, where, LOOKING, seconds, looks=True)
            ratios.append(share / without)
            memories.append(memory)
            rates.append(rate)
    print(
        f"\n{LOOKING} pages that look at the camera: "
        f"{statistics.median(ratios):.1f} times the CPU of {LOOKING} without "
        f"({', '.join(f'{ratio:.1f}' for ratio in ratios)}), {max(memories) / 1e6:.0f} MB, "
        f"{statistics.median(rates):.0f} kB/s to each."
    )
    compressed, plain, files = await _first_load(where)
    print(
        f"\nMemory: goal {MEMORY_GOAL}. First load: {compressed / 1000:.0f} kB compressed, "
        f"{plain / 1000:.0f} kB as files ({files}); goal {LOAD_GOAL}.\n"
        f"Python {sys.version.split()[0]}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}"
    )


async def _with(
    web: subprocess.Popen[str], where: str, count: int, seconds: float, *, looks: bool = False
) -> tuple[float, int, float]:
    """CPU in cores, memory in bytes, and kB a second to each page, with so many pages."""
    received = [0] * count
    pages = [
        asyncio.create_task(_page(where, received, index, drives=index == 0))
        for index in range(count)
    ]
    if looks:
        pages += [asyncio.create_task(_look(where, received, index)) for index in range(count)]
    # Let the start pass.
    await asyncio.sleep(4.0)
    before, used_s, begun = sum(received), _cpu_s(web.pid), time.monotonic()
    await asyncio.sleep(seconds)
    took = time.monotonic() - begun
    share = (_cpu_s(web.pid) - used_s) / took
    rate = (sum(received) - before) / took / max(1, count) / 1000
    memory = _memory(web.pid)
    for page in pages:
        page.cancel()
    await asyncio.gather(*pages, return_exceptions=True)
    return share, memory, rate


async def _send_pictures(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    """A camera of random bytes in a JPEG's headers: each picture is new."""
    await reader.readuntil(b"\r\n\r\n")
    kind = b"multipart/x-mixed-replace; boundary=b"
    writer.write(b"HTTP/1.0 200 OK\r\nContent-Type: " + kind + b"\r\n\r\n")
    head = b"\xff\xd8\xff\xc0\x00\x0b\x08\x01\xe0\x02\x80\x01\x01\x11\x00"
    with suppress(ConnectionError):
        while not writer.is_closing():
            picture = head + secrets.token_bytes(PICTURE_BYTES)
            writer.write(b"--b\r\nContent-Length: %d\r\n\r\n%b\r\n" % (len(picture), picture))
            await writer.drain()
            await asyncio.sleep(1.0 / PICTURES_A_SECOND)
    writer.close()


async def _look(where: str, received: list[int], index: int) -> None:
    address = f"ws://{where}/camera"
    async with connect(address, origin=f"http://{where}", compression=None) as socket:
        while True:
            await socket.send("")
            received[index] += len(await socket.recv())


async def _page(where: str, received: list[int], index: int, *, drives: bool) -> None:
    async with connect(f"ws://{where}/ws", origin=f"http://{where}", compression=None) as socket:
        if drives:
            await socket.send('{"type":"control","want":true}')
        async for frame in socket:
            received[index] += len(frame)
            # A beat comes every 50 ms, and one command answers each.
            beat = re.search(r'"beat":(\d+)', str(frame))
            if drives and beat is not None:
                command = {"type": "drive", "beat": int(beat[1]), "vx": 0.2, "vy": 0, "wz": 0.5}
                await socket.send(json.dumps(command))


async def _first_load(where: str) -> tuple[int, int, int]:
    """The bytes of the page and of all that it names, compressed and not, and how many files."""
    seen: dict[str, tuple[int, int]] = {}
    left = ["/"]
    while left:
        path = left.pop()
        if path in seen:
            continue
        text = await _get(where, path, "identity")
        seen[path] = len(await _get(where, path, "gzip")), len(text)
        with suppress(UnicodeDecodeError):
            names = re.findall(r"""["'](?:/page/|\./)([\w./-]+\.\w+)["']""", text.decode())
            left += [f"/page/{name}" for name in names]
    return sum(one for one, _ in seen.values()), sum(two for _, two in seen.values()), len(seen)


async def _get(where: str, path: str, encoding: str) -> bytes:
    host, _, port = where.partition(":")
    reader, writer = await asyncio.open_connection(host, int(port))
    writer.write(
        f"GET {path} HTTP/1.1\r\nHost: {where}\r\nAccept-Encoding: {encoding}\r\n"
        "Connection: close\r\n\r\n".encode()
    )
    answer = await reader.read()
    writer.close()
    head, _, body = answer.partition(b"\r\n\r\n")
    return body if b" 200 " in head.split(b"\r\n")[0] else b""


def _yahboomd(*arguments: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "yahboomd", *arguments], stdout=subprocess.PIPE, text=True
    )


def _cpu_s(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _memory(pid: int) -> int:
    status = Path(f"/proc/{pid}/status").read_text()
    found = re.search(r"VmRSS:\s+(\d+) kB", status)
    assert found is not None
    return int(found[1]) * 1024


if __name__ == "__main__":
    sys.exit(main())
