"""Stands where zenohd with its web plugins does, and answers every request: ``... -c CONFIG``.

Each request is a line in the file ``reached`` of the current folder.
"""

from __future__ import annotations

import base64
import hashlib
import http.server
import threading
from pathlib import Path

REACHED = Path("reached").absolute()
PORTS = {"rest": 8000, "remote_api": 10000}


class Handler(http.server.BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"

    def do_any(self) -> None:
        with REACHED.open("a") as file:
            file.write(f"{self.requestline}\n")
        self.rfile.read(int(self.headers.get("Content-Length", "0")))
        if self.headers.get("Upgrade") == "websocket":
            key = self.headers["Sec-WebSocket-Key"] + "258EAFA5-E914-47DA-95CA-C5AB0DC85B11"
            accept = base64.b64encode(hashlib.sha1(key.encode()).digest()).decode()
            self.send_response(101)
            self.send_header("Upgrade", "websocket")
            self.send_header("Connection", "Upgrade")
            self.send_header("Sec-WebSocket-Accept", accept)
            self.end_headers()
            self.close_connection = True
            return
        self.send_response(200)
        self.send_header("Access-Control-Allow-Origin", "*")  # as the REST plugin does
        self.send_header("Content-Length", "2")
        self.end_headers()
        self.wfile.write(b"{}")

    do_GET = do_POST = do_PUT = do_PATCH = do_DELETE = do_OPTIONS = do_any  # noqa: N815

    def log_message(self, *_: object) -> None:
        pass


servers = [http.server.ThreadingHTTPServer(("127.0.0.1", port), Handler) for port in PORTS.values()]
for server in servers[1:]:
    threading.Thread(target=server.serve_forever).start()
servers[0].serve_forever()
