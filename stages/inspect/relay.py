"""Passes the web viewer on to browsers with a policy that lets it speak to this machine only.

The viewer that runs in a browser would report its use, look for new versions and load fonts from elsewhere, whatever
the settings of the program that serves it are. A Content-Security-Policy is kept by the browser itself.
"""

from __future__ import annotations

import contextlib
import http.client
import shutil
import threading
import urllib.error
import urllib.request
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

KEPT = ("Content-Type", "Content-Length", "Content-Encoding", "rerun-final-length")
"""Headers of the viewer's server that are passed on; by the last one its page shows how much has been loaded."""

DIRECT = urllib.request.build_opener(urllib.request.ProxyHandler({}))
"""What is on this machine is not asked of a proxy."""

SECONDS = 30.0
"""For which an answer of the viewer's server is waited for."""


def policy(feed: str) -> str:
    """What the page may load and speak to: its own server, and that of the recording, e.g. ``http://127.0.0.1:9876``."""
    return (
        f"default-src 'self' {feed}; script-src 'self' 'unsafe-inline' 'unsafe-eval' 'wasm-unsafe-eval' blob:; "
        "style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; worker-src 'self' blob:; frame-ancestors 'none'"
    )


@contextlib.contextmanager
def relayed(host: str, wanted: int, behind: str, feed: str) -> Iterator[int]:
    """Serve at a port of this machine what is served at `behind`, an address without a path, until it is left.

    Gives the port: `wanted`, or, where that is taken, another one.
    """

    class Relay(BaseHTTPRequestHandler):
        """Answers one request."""

        def do_GET(self) -> None:
            """Pass a page or a file on."""
            try:
                with DIRECT.open(behind + self.path, timeout=SECONDS) as answer:
                    self.send_response(answer.status)
                    for name in KEPT:
                        if name in answer.headers:
                            self.send_header(name, answer.headers[name])
                    self.send_header("Content-Security-Policy", policy(feed))
                    self.end_headers()
                    shutil.copyfileobj(answer, self.wfile)
            except urllib.error.HTTPError as error:
                self.send_error(error.code)
            except ConnectionError:
                pass  # the browser has gone
            except (http.client.HTTPException, ValueError):  # no path that can be asked for
                self.send_error(400)
            except OSError:
                self.send_error(502)

        def log_message(self, format: str, *args: object) -> None:
            """Nothing: the console prints."""

    try:
        server = ThreadingHTTPServer((host, wanted), Relay)
    except OSError:
        server = ThreadingHTTPServer((host, 0), Relay)
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield server.server_port
    finally:
        server.shutdown()
        server.server_close()
        thread.join()
