"""The frame of every page: bar with stop button, navigation, alarms."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any
from urllib.parse import quote

from nicegui import ui

from torquebench.panel.components.controls import button, link_button
from torquebench.panel.components.dialogs import ask
from torquebench.panel.components.elements import box, icon, on_press, repeat, words
from torquebench.panel.components.messages import Messages
from torquebench.panel.pages.jobs.strip import JobStrip
from torquebench.panel.pages.menu import Menu
from torquebench.panel.pages.page import PAGES
from torquebench.panel.pages.view import part
from torquebench.panel.pages.visitor import Visitor
from torquebench.panel.service import AlarmView, BenchService, NotSignedInError
from torquebench.panel.text import JOB_STATES, Text

REFRESH_S = 0.5
LANGUAGE_TAGS = {"en": "en", "zh": "zh-CN"}


def head(text: Text, look: str, title: str) -> None:
    """Fill the page's head with the common elements."""
    ui.page_title(page_title(title))
    ui.add_head_html(head_html(text, look))


def page_title(title: str) -> str:
    """Return the title of the browser's window."""
    return f"{title} · torquebench"


def head_html(text: Text, look: str) -> str:
    """Return the head of every page; scripts are in separate files."""
    texts = {
        "stopFailed": text(
            "The stop did not reach the bench. Use the red emergency stop button on the machine."
        ),
        "lost": text("Connection to the bench lost. The values are old."),
        "reconnecting": text(
            "Trying to connect again. If this lasts, use the red emergency stop button "
            "on the machine."
        ),
        "tooLong": text("The page tried to send more than the bench accepts."),
        "shorten": text("Load the page again and enter less."),
        "unready": text(
            "Not connected yet: nothing was done. Press again once the button no longer waits."
        ),
        "unheard": text(
            "The connection broke while “{what}” was pressed. Check whether it was "
            "done before you press again.",
            what="{what}",
        ),
        "changed": text(
            "The page changed while “{what}” was pressed: nothing was done. Look at it "
            "and press again.",
            what="{what}",
        ),
        "savePicture": text("Save the chart as a picture"),
        "saveTable": text("Save the chart's values as CSV"),
    }
    said = json.dumps(texts).replace("<", "\\u003c")
    return (
        '<link rel="stylesheet" href="/panel/static/panel.css">'
        f'<script src="/panel/static/look.js" data-language="{LANGUAGE_TAGS[text.language]}"'
        f' data-look="{look}"></script>'
        f'<script type="application/json" id="panel-texts">{said}</script>'
        '<script defer src="/panel/static/panel.js"></script>'
    )


STOP = {
    "type": "button",
    "data-stop": "1",
    "aria-keyshortcuts": "F8",
}
"""Attributes of a stop button, whose request the browser sends with priority."""


class _Frame:
    """The variable parts around a page's content."""

    def __init__(self, visitor: Visitor, current: str) -> None:
        self.visitor = visitor
        self.text = visitor.text
        self._shown: tuple[Any, ...] = ()
        self._path = PAGES[current].path
        client = ui.context.client
        with client.layout:
            with box("div") as before:
                words("a", self.text("Skip to the page's content"), "skip", href="#content")
                self._bar()
                self._rail(current)
            before.move(client.layout, 0)  # before the page's content, also for Tab
            self.visitor.messages = Messages(self.text)
            self.job = JobStrip(self.visitor)

    def _bar(self) -> None:
        text = self.text
        with box("header", "bar"):
            with box("div", "bench"):
                with box("div"):
                    self._bench = words("span", "")
                with box("div", "below"):
                    self._simulated = words("span", "", "tag warn")
                    self._command = words("span", "")
                    self._mounted = words("span", "", "optional")
            with box("div", "person"):
                actor = self.visitor.looker
                words("div", actor.name)
                words("div", text(actor.role))
            with box("div", "optional"):
                self._take = button(text("Take command"), self._take_command, "quiet small")
                self._give = button(text("Give up command"), self._give_command, "quiet small")
            menu = Menu(self.visitor, self._take_command, self._give_command)
            opener = box(
                "button",
                "control quiet",
                type="button",
                aria_label=text("Menu"),
                aria_keyshortcuts="?",
                data_menu="1",
            )
            with opener:
                icon("menu")
            on_press(opener, menu.open)
            stop = words("button", text("STOP"), "stop")
            label = text("Stop the bench: zero torque, drives off (F8)")
            stop.props.update(STOP | {"aria-label": label, "title": label})

    def _rail(self, current: str) -> None:
        with box("nav", "rail", aria_label=self.text("Pages")), box("ul"):
            for page in sorted(PAGES.values(), key=lambda page: page.place):
                if not page.place:
                    continue
                here = "page" if page.name == current else None
                with (
                    box("li"),
                    box(
                        "a",
                        href=page.path,
                        aria_current=here,
                        data_shortcut=str(page.place),
                        aria_keyshortcuts=f"Alt+{page.place}",
                    ),
                ):
                    icon(page.picture)
                    words("span", self.text(page.title))
                    if page.name == "alarms":
                        self._count = words("span", "", "count")

    def strips(self) -> None:
        """Add the areas for important messages above the page's content."""
        words("div", "", "note bad", id="stop-result", role="alert", hidden="hidden")
        words("div", "", "note warn", id="press-result", role="alert", hidden="hidden")
        self._notice = words("div", "", id="notice", hidden="hidden")
        self._alarm = box("div", "alarm-strip", role="alert")
        with self._alarm:
            icon("warning")
            self._alarm_text = words("div", "")
            if self._path != "/alarms":
                link_button(self.text("See the alarms"), "/alarms")
        self._alarm.set_visibility(False)
        self._lost = words("div", "", "note bad no-readings", role="alert")
        self._lost.set_visibility(False)
        self._presence = box("div", "note spread presence")
        with self._presence:
            self._presence_text = words("div", "", role="timer")
            button(self.text("I am at the bench"), self._present, "primary", picture="person_pin")
        self._presence.set_visibility(False)

    def refresh(self) -> None:
        """Update the parts that show the bench's state, if it has changed."""
        service, text = self.visitor.service, self.text
        try:
            commands = self.visitor.commands
        except NotSignedInError:
            here = quote(self.visitor.address)
            ui.navigate.to(f"/sign-in?reason=expired&next={here}")
            return
        self._notify()
        self._presence.set_visibility(service.presence_wanted and commands)
        if service.presence_wanted and commands:
            left = math.ceil(service.presence_left_s)
            said = text(
                "The drives have power only while somebody is at the bench. Confirmed for "
                "{seconds} s more."
                if left
                else "The drives have power only while somebody is at the bench. Take command "
                "there and confirm.",
                seconds=left,
            )
            self._presence_text.set_text(said)
        snapshot = service.snapshot()
        latched = _latched(service) if snapshot.stopped else None
        shown = (
            snapshot.bench_name,
            snapshot.simulated,
            snapshot.mounted,
            snapshot.commanded_by,
            commands,
            snapshot.alarms,
            snapshot.connection,
            None if latched is None else latched.found,
        )
        if shown == self._shown:
            return
        self._shown = shown
        self._bench.set_text(text(snapshot.bench_name))
        self._simulated.set_text(text("simulated") if snapshot.simulated else "")
        self._simulated.set_visibility(snapshot.simulated)
        self._mounted.set_text(text("Mounted: {what}", what=text(snapshot.mounted)))
        self._command.set_text(command_words(text, commands, snapshot.commanded_by))
        self._take.set_visibility(not commands)
        self._give.set_visibility(commands)
        self._count.set_text(str(snapshot.alarms) if snapshot.alarms else "")
        self._alarm.set_visibility(latched is not None)
        if latched is not None:
            self._alarm_text.set_text(
                text("The bench is stopped: {found}", found=text(latched.found))
            )
        self._lost.set_visibility(snapshot.connection != "live")
        if snapshot.connection != "live":
            said = text(
                "Bench lost: {problem}"
                if snapshot.connection == "lost"
                else "No new readings: {problem}",
                problem=text(snapshot.connection_problem),
            )
            self._lost.set_text(said)

    def _notify(self) -> None:
        """Send the browser the newest alarm and the user's newest finished job."""
        service, text = self.visitor.service, self.text
        alarm = max(service.alarms(active=True), key=lambda alarm: alarm.number, default=None)
        jobs = (job for job in service.jobs.recent() if not job.open)
        job = next((job for job in jobs if job.started_by == self.visitor.looker.label), None)
        news: dict[str, tuple[str, str]] = {}
        if alarm is not None:
            said = f"{text.alarm(alarm.kind)}: {text(alarm.found)}"
            news["alarm"] = (alarm.alarm_id, said)
        if job is not None:
            title = text(job.title)
            state = text(JOB_STATES[job.state])
            news["job"] = (job.job_id, text("{title}: {state}", title=title, state=state))
        self._notice.set_text(json.dumps(news))

    def _present(self) -> None:
        self.visitor.act(self.visitor.service.confirm_presence)
        self.refresh()

    def _take_command(self) -> None:
        visitor, text = self.visitor, self.text
        lease = visitor.service.lease
        free, reason = lease.may_take(visitor.actor)
        if free or not visitor.has_role("metrologist"):
            visitor.act(lease.take)
            self.refresh()
            return

        def take(_: str) -> None:
            visitor.act(lease.take, force=True)
            self.refresh()

        ask(
            text,
            text("Take command"),
            text("{reason}. Taking command away from somebody is recorded.", reason=text(reason)),
            take,
            danger=True,
        )

    def _give_command(self) -> None:
        self.visitor.act(self.visitor.service.lease.give_back)
        self.refresh()


def _latched(service: BenchService) -> AlarmView | None:
    """Return the first active critical alarm."""
    active = service.alarms(active=True)
    return next((alarm for alarm in active if alarm.level == "critical"), None)


def command_words(text: Text, mine: bool, holder: str | None) -> str:
    """Return the text that states who commands the bench."""
    if mine:
        return text("You are in command")
    return text("In command: {who}", who=holder) if holder else text("Nobody is in command")


@contextmanager
def frame(
    visitor: Visitor, current: str, on_refresh: Callable[[], Any] | None = None, title: str = ""
) -> Iterator[Any]:
    """Put a page's content into the frame; `on_refresh` is called twice a second.

    `current` is the name of the page, or of the page to which it belongs in the navigation.
    """
    text = visitor.text
    title = title or text(PAGES[current].title)
    head(text, visitor.look, title)
    around = _Frame(visitor, current)

    made = False

    def refresh() -> None:
        around.refresh()
        if on_refresh is not None and made:
            on_refresh()
        if made:
            around.job.refresh()

    with box("div", "page", id="content", tabindex="-1") as content:
        around.strips()
        with box("div", "title") as heading:
            words("h1", title)
        content.title_line = heading
        with part(text):
            yield content
            made = True
    with content, part(text):
        refresh()
    repeat(REFRESH_S, refresh)
