"""What each visitor alone sees: who leads, the button to take over, and the colours of the page."""

from viser import ClientHandle, GuiButtonHandle, GuiHtmlHandle, ViserServer

from pipeline.browser.page.elements.texts import paragraph
from pipeline.browser.page.visitors import Visitors


def set_theme(target: ClientHandle | ViserServer, *, dark: bool) -> None:
    """Set how the page looks, for one visitor or for all."""
    target.gui.configure_theme(dark_mode=dark, show_logo=False, show_share_button=False)


def notify(client: ClientHandle, line: str) -> None:
    """Show one visitor a line for a few seconds."""
    client.add_notification("reenact", line, auto_close_seconds=4.0)


class VisitorBar:
    """Line and buttons of one visitor.

    Parameters
    ----------
    client : ClientHandle
        The visitor.
    visitors : Visitors
        Who is there.
    """

    def __init__(self, client: ClientHandle, visitors: Visitors) -> None:
        self._client, self._visitors = client, visitors
        self._line: GuiHtmlHandle = client.gui.add_html("", order=-2)
        self._button: GuiButtonHandle = client.gui.add_button("Take over", order=-1)
        self._shown: tuple[str, bool] | None = None

        self._dark = client.gui.add_checkbox("Dark", initial_value=False, order=1000)
        self._button.on_click(lambda _event: visitors.take_over(client.client_id))
        self._dark.on_update(lambda _event: set_theme(client, dark=self._dark.value))

    def show(self) -> None:
        """Show who leads now."""
        visitor = self._client.client_id
        shown = self._visitors.line(visitor), self._visitors.leads(visitor)
        if shown != self._shown:
            self._shown = shown
            self._line.content = paragraph(shown[0], name="visitor")
            self._button.visible = not shown[1]

    def notify(self, line: str) -> None:
        """Show this visitor a line for a few seconds."""
        notify(self._client, line)
