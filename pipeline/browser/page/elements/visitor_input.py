"""Elements that visitors set and the program shows: what a visitor sets is taken as it came, and then what is so shown.

The server keeps what a browser sends in the element, and calls back. A program that writes to the element between the
two has the visitor's value lost: so it writes on the server's own thread, which does both without a pause.
"""

from collections.abc import Callable, Sequence
from concurrent.futures import Future
from typing import Any, TypeAlias

from viser import GuiEvent, ViserServer

Allowed: TypeAlias = Callable[[int | None], bool]
"""Whether a visitor, by number, may do something; who may not is shown why."""

Take: TypeAlias = Callable[[Any], "Future[Any] | None"]
"""Takes a visitor's value; returns the work that it causes, where that takes a while."""


class VisitorInput:
    """Element that visitors set; of whoever may not set it, and once it is done, it shows what is so.

    Parameters
    ----------
    server : ViserServer
        The page.
    element : GuiInputHandle
        The element.
    allowed : callable
        Whether a visitor may set it.
    take : callable
        Takes the value of one who may, on the server's thread.
    rest_s : float
        For how long a visitor's value is left as it is [s]: of a slider, while it is dragged.

    Attributes
    ----------
    element : GuiInputHandle
        The element.
    """

    def __init__(self, server: ViserServer, element: Any, *, allowed: Allowed, take: Take, rest_s: float = 0.0) -> None:
        self._loop, self.element = server.get_event_loop(), element
        self._allowed, self._take, self._rest_s = allowed, take, rest_s
        self._work: Future[Any] | None = None
        self._rests_until_s = 0.0
        element.on_update(self._come)

    def show(self, read: Callable[[], Any], *, options: Sequence[str] = ()) -> None:
        """Show what is so, which is read once it is shown, unless a visitor's value is being worked on.

        Parameters
        ----------
        read : callable
            Returns the value; one that is none of the options is not shown.
        options : sequence of str
            All that can be chosen; nothing where it is no choice.
        """
        self._loop.call_soon_threadsafe(self._show, read, tuple(options))

    def _show(self, read: Callable[[], Any], options: tuple[str, ...]) -> None:
        if options and tuple(self.element.options) != options:
            self.element.options = options
        is_worked_on = self._work is not None and not self._work.done()
        if is_worked_on or self._loop.time() < self._rests_until_s:
            return
        value = read()
        if not options or value in options:
            self.element.value = value

    async def _come(self, event: GuiEvent[Any]) -> None:
        """Take a visitor's value; awaited one after the other, on the thread that has just stored it."""
        if event.client_id is not None and self._allowed(event.client_id):
            self._rests_until_s = self._loop.time() + self._rest_s
            self._work = self._take(event.target.value)


class StoredInput(VisitorInput):
    """Element whose value has no effect but to be there, for what a visitor does next.

    Parameters
    ----------
    server : ViserServer
        The page.
    element : GuiInputHandle
        The element.
    allowed : callable
        Whether a visitor may set it.

    Attributes
    ----------
    element : GuiInputHandle
        The element.
    value : object
        The last value of one who may, or what the program has set since.
    """

    def __init__(self, server: ViserServer, element: Any, *, allowed: Allowed) -> None:
        super().__init__(server, element, allowed=allowed, take=self._store)
        self.value: Any = element.value

    def show_value(self, *, options: Sequence[str] = ()) -> None:
        """Show the value; one that is none of the options any more gives way to the first of them."""
        if options and self.value not in options:
            self.value = options[0]
        self.show(lambda: self.value, options=options)

    def _store(self, value: Any) -> None:
        self.value = value


def set_visible(visible: bool, *elements: Any) -> None:
    """Change what is to be seen only where it is otherwise: nothing is sent of what stays."""
    for element in elements:
        if element.visible != visible:
            element.visible = visible
