"""The page's server."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from importlib.util import find_spec
from io import StringIO
from typing import Any

from omniservo.errors import InputError
from omniservo.viewer.controls import add_panels
from omniservo.viewer.open_viewed import Viewed
from omniservo.viewer.page import Page

HOST = "127.0.0.1"
"""Only this machine reaches the page."""


def require_viser() -> None:
    """Refuse to go on without what draws the page.

    Raises:
        InputError: it is not installed; the message says how it is.
    """
    if find_spec("viser") is None:
        raise InputError('view: the live page needs viser: pip install "omniservo[view]"')


def _refuse_other_pages(server: Any) -> None:
    """Have connections closed that another web page in the same browser opens, before anything is sent.

    viser does not look at what a browser says of where a connection comes from, and has no option for it:
    this reaches for its connections.
    """
    web = server._websock_server

    async def refuse(client: Any) -> None:
        connection = web._live_connections[client.client_id]
        headers = connection.request.headers
        origin, own = headers.get("Origin"), {f"http://{name}:{web._port}" for name in (HOST, "localhost")}
        if origin is not None and origin not in own:
            await connection.close(1008, "this page is served to itself alone")

    web.on_client_connect(refuse)


@contextmanager
def serve_page(viewed: Viewed, *, port: int = 8080) -> Iterator[Page]:
    """Serve the page to this machine alone, with its first plan on it; it ends with the block.

    Args:
        viewed: what it begins with.
        port: at which; the next that is free, if it is taken.

    Raises:
        InputError: viser is not installed.
    """
    require_viser()
    import viser

    with redirect_stdout(StringIO()):  # it prints what the command says in its own way
        server: Any = viser.ViserServer(host=HOST, port=port, verbose=False)
    _refuse_other_pages(server)
    page = Page(server, viewed)
    try:
        page.begin(add_panels(server, page))
        yield page
    finally:
        page.close()
        with redirect_stdout(StringIO()):
            server.stop()
