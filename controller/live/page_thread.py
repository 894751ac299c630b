"""Serves the rows of a running loop to browsers, in a thread of the door.

The page's files are served at once. What reads the rows is imported meanwhile, which takes most of
a second; a page that comes sooner waits for its first rows with its panels drawn.
"""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Any

from websockets.asyncio.server import ServerConnection

from haptic_wall.controller.live.gate import judged
from haptic_wall.controller.live.place import Live
from haptic_wall.controller.live.web_server import closed, opened, silenced
from haptic_wall.controller.runtime.realtime import stand_back
from haptic_wall.controller.system.orders import say

if TYPE_CHECKING:
    from haptic_wall.controller.live.server import LiveServer


def serve_page(orders: dict[str, Any], ends: Callable[[], bool]) -> None:
    """Serve the page until ``ends``; tell the supervisor if it is gone sooner.

    Args:
        orders: Of the run's supervisor.
        ends: Whether a signal asked for the end.
    """
    silenced()
    try:
        asyncio.run(serve(orders, ends))
    except Exception as error:  # noqa: BLE001 - whatever it is, changes and stream go on
        why = getattr(error, "strerror", None) or f"{type(error).__name__}: {error}"
        say({"page": f"the page is gone ({why})"})


async def serve(orders: dict[str, Any], ends: Callable[[], bool]) -> None:
    """Serve until ``ends`` or the supervisor says so.

    Args:
        orders: Of the run's supervisor.
        ends: Whether a signal asked for the end.
    """
    live = Live(**orders["live"])
    ready: asyncio.Future[LiveServer] = asyncio.get_running_loop().create_future()

    async def attend(connection: ServerConnection) -> None:
        await (await asyncio.shield(ready)).attend(connection)

    server = await opened(
        socket.socket(fileno=live.descriptor), attend, lambda request: judged(request, live.host)
    )
    with ThreadPoolExecutor(1) as executor:
        make = asyncio.get_running_loop().run_in_executor(executor, _imported)
        running, until = (await make)(orders, live, ends)
    # Threads that compute for the page later are begun by this one, and take its priority.
    stand_back()
    ready.set_result(running)
    await running.pump(until)
    await closed(server)
    running.abort()


def _imported() -> Callable[
    [dict[str, Any], Live, Callable[[], bool]], tuple[LiveServer, Callable[[], bool]]
]:
    """Import what reads the rows; return what makes the server of a run and its end."""
    from haptic_wall.controller.live.running_view import views_of
    from haptic_wall.controller.live.server import LiveServer
    from haptic_wall.controller.runtime.idle_window import until_idle_window

    def made(
        orders: dict[str, Any], live: Live, ends: Callable[[], bool]
    ) -> tuple[LiveServer, Callable[[], bool]]:
        views, news, telemetry = views_of(orders)
        period_ns: int = orders["period_ns"]

        def until() -> bool:
            over = ends()
            news.take()
            return over

        def pause(wanted_s: float) -> float:
            return until_idle_window(telemetry.words, period_ns, wanted_s)

        return LiveServer(views, live.host, live.token, Path(orders["run"]), pause), until

    return made
