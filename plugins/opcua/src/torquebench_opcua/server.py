"""The OPC UA server on one open bench: a thread with an event loop of its own."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import threading
import uuid
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime
from typing import Any, Self

from asyncua import Server, ua
from asyncua.common.event_objects import AlarmCondition, BaseEvent

from torquebench.atomic_write import private_folder
from torquebench.errors import InputError, TorquebenchError
from torquebench.message import Message
from torquebench.panel.beside import ServedBench
from torquebench.panel.service import Actor, AlarmView
from torquebench_opcua.access import Gate, GuardedServer, SignedIn, Store, caller
from torquebench_opcua.endpoint import Endpoint
from torquebench_opcua.files import Transfers
from torquebench_opcua.mapping import live_values, machine_state, severity
from torquebench_opcua.nodes import AddressSpace, Methods
from torquebench_opcua.results import (
    Condition,
    ResultReader,
    ResultRecord,
    condition,
    field_value,
    ordered,
    result_file,
)

__all__ = ["OpcUaServer"]

LIVE_S = 0.1
SLOW_S = 2.0
START_S = 60.0
NO_SUCH_RESULT = 1
"""Error of the methods on results."""
_ACKNOWLEDGE = ua.NodeId(ua.ObjectIds.AcknowledgeableConditionType_Acknowledge)


class OpcUaServer:
    """Serves a bench by OPC UA while it is entered.

    Parameters
    ----------
    bench : ServedBench
        Stays open.
    endpoint : Endpoint
        Port 0 takes a free one.
    note : callable
        Told what clients have to know.

    Raises
    ------
    InputError
        The port is taken, or the server's certificate can't be used.
    """

    def __init__(
        self, bench: ServedBench, endpoint: Endpoint, note: Callable[[str], None] | None = None
    ) -> None:
        self._bench = bench
        self._endpoint = endpoint
        self._note = note or (lambda _text: None)
        private_folder(bench.data_dir)
        self.store = Store(bench.data_dir)
        self._gate = Gate(bench, self.store)
        self._serial = _serial(bench.description.name)
        self._reader = ResultReader()
        self._ended: asyncio.Event | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._ready = threading.Event()
        self._failed: BaseException | None = None
        self._handles = 0
        self._records: tuple[ResultRecord, ...] = ()
        self._alarms: dict[str, tuple[AlarmView, bytes]] = {}
        self.url = self.uri = ""
        self._thread = threading.Thread(target=self._run, name="torquebench-opcua", daemon=True)

    def __enter__(self) -> Self:
        self.uri = self.store.prepare(self._endpoint.host, self._serial, self._note)
        logging.getLogger("asyncua").setLevel(logging.CRITICAL)
        self._thread.start()
        if not self._ready.wait(START_S) or self._failed is not None:
            raise InputError(
                Message(
                    "{url}: {failed}",
                    self._endpoint.url(self._endpoint.port),
                    self._failed or "no answer",
                ),
                "a free port of this machine",
                "give another port, or 0 for any",
            )
        return self

    def __exit__(self, *_: object) -> None:
        if self._loop is not None and self._ended is not None and self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._ended.set)
        self._thread.join(START_S)

    # -- the thread -------------------------------------------------------------------------

    def _run(self) -> None:
        try:
            asyncio.run(self._serve())
        except BaseException as error:  # reported to the caller that waits for the start
            self._failed = error
        finally:
            self._ready.set()

    async def _serve(self) -> None:
        self._loop, self._ended = asyncio.get_running_loop(), asyncio.Event()
        # one thread for records and accounts, so that the disk doesn't delay live values
        self._loop.set_default_executor(ThreadPoolExecutor(1, "torquebench-opcua-records"))
        inner = GuardedServer(self._gate)
        inner.bind_condition_methods = True
        inner.allow_remote_admin = False
        server = Server(iserver=inner)
        await server.init()
        await server.set_application_uri(self.uri)
        server.set_server_name(f"torquebench {self._bench.description.name}")
        server.application_type = ua.ApplicationType.Server
        server.set_endpoint(self._endpoint.url(self._endpoint.port))
        server.set_security_policy([ua.SecurityPolicyType.Basic256Sha256_SignAndEncrypt])
        server.set_identity_tokens([ua.UserNameIdentityToken])
        await server.load_certificate(str(self.store.certificate))
        await server.load_private_key(str(self.store.key))
        server.set_certificate_validator(self._gate.validate)
        self._server = server
        methods = Methods(
            self._latest, self._by_id, self._filtered, self._release, self._acknowledged, self._file
        )
        self._space = await AddressSpace.build(
            server, self.uri, self._serial, self._bench.snapshot(), methods
        )
        self._transfers = Transfers(server, self._space.index)
        inner.isession.add_method_callback(_ACKNOWLEDGE, self._acknowledge)
        await self._show_slow(first=True)
        await self._show_live()  # a value that was never measured isn't published
        async with server:
            assert server.bserver is not None
            self.url = self._endpoint.url(int(server.bserver.port or self._endpoint.port))
            self._ready.set()
            await self._update(inner)

    async def _update(self, inner: GuardedServer) -> None:
        """Write changes until the server ends; a failure of one part doesn't affect the others."""
        assert self._ended is not None
        rounds = 0
        while not self._ended.is_set():
            with contextlib.suppress(TorquebenchError):
                await self._show_live()
                await self._show_alarms()
            rounds += 1
            if rounds % round(SLOW_S / LIVE_S) == 0:
                with contextlib.suppress(TorquebenchError):
                    await self._show_slow()
                await self._transfers.forget()
                await self._send_away(inner)
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self._ended.wait(), LIVE_S)

    async def _send_away(self, inner: GuardedServer) -> None:
        """Close sessions of accounts without permission."""
        for session in inner.outside:
            user = session.user
            if isinstance(user, SignedIn) and user.actor is not None:
                actor = user.actor
                if await asyncio.to_thread(self._bench.present, actor) is None:
                    user.actor = None
                    await session.close_session(True)

    # -- publishing -------------------------------------------------------------------------

    async def _show_live(self) -> None:
        bench = self._bench.snapshot()
        await self._space.write_live(live_values(bench))
        await self._space.write_state(machine_state(bench))
        about = {
            "Simulated": bench.simulated,
            "Mounted": bench.mounted,
            "JobId": bench.job_id or "",
            "CommandedBy": bench.commanded_by or "",
            "ActiveAlarms": bench.alarms,
        }
        await self._space.write_about(about)

    async def _show_slow(self, *, first: bool = False) -> None:
        self._records = await asyncio.to_thread(self._reader.newest, self._bench.records)
        for record in await self._space.show_results(self._records):
            if not first:
                await self._tell_result(record)

    async def _tell_result(self, record: ResultRecord) -> None:
        event: Any = BaseEvent()
        event.EventType = ua.NodeId(1002, self._space.result_index)
        event.add_property(
            "Result", self._space.result_data(record), ua.VariantType.ExtensionObject
        )
        assert self._space.management is not None
        await self._tell(
            event, self._space.management.nodeid, record.result_id,
            f"result {record.result_id} is ready", 100, record.created,
        )  # fmt: skip

    async def _show_alarms(self) -> None:
        """Report conditions whose state has changed."""
        seen = {each.alarm_id: each for each in self._bench.alarms()}
        for alarm_id, alarm in reversed(seen.items()):
            known = self._alarms.get(alarm_id)
            if known is not None and known[0] == alarm:
                continue
            if known is None and not alarm.active:
                self._alarms[alarm_id] = (alarm, b"")
                continue
            self._alarms[alarm_id] = (alarm, await self._tell_alarm(alarm))
        for gone in [each for each in self._alarms if each not in seen]:
            del self._alarms[gone]
        await self._space.show_alarms([each for each in seen.values() if each.active])

    async def _tell_alarm(self, alarm: AlarmView) -> bytes:
        event: Any = AlarmCondition()
        acked = alarm.acknowledged is not None or not alarm.active
        state = {
            "EnabledState": (True, "Enabled", "Disabled"),
            "ActiveState": (alarm.active, "Active", "Inactive"),
            "AckedState": (acked, "Acknowledged", "Unacknowledged"),
        }
        for name, (value, true, false) in state.items():
            setattr(event, name, ua.LocalizedText(true if value else false, "en"))
            setattr(event, f"{name}/Id", value)
        event.add_property("NodeId", self._space.alarm_id(alarm), ua.VariantType.NodeId)
        event.ConditionClassId = ua.NodeId(ua.ObjectIds.ProcessConditionClassType)
        event.ConditionClassName = ua.LocalizedText("Process", "en")
        event.ConditionName = alarm.kind
        event.Retain = alarm.active
        event.SuppressedOrShelved = False
        event.ClientUserId = alarm.acknowledged_by
        event.Quality = ua.StatusCode(ua.StatusCodes.Good)
        when = alarm.cleared or alarm.acknowledged or alarm.raised
        return await self._tell(
            event, self._space.bench.nodeid, alarm.source, alarm.message, severity(alarm), when
        )

    async def _tell(
        self, event: Any, source: ua.NodeId, name: str, words: str, how_severe: int, when: datetime
    ) -> bytes:
        """Send an event to the subscribers of the server's or the bench's events."""
        identifier = uuid.uuid4().bytes
        event.EventId = identifier
        event.SourceNode, event.SourceName = source, name
        event.Time = when.astimezone(UTC)
        event.ReceiveTime = datetime.now(UTC)
        event.LocalTime = ua.TimeZoneDataType()
        event.Message = ua.LocalizedText(words, "en")
        event.Severity = how_severe
        trigger = self._server.iserver.subscription_service.trigger_event
        # the server last: a refresh repeats its retained events, and clients subscribe there
        for emitting in (self._space.bench.nodeid, ua.NodeId(ua.ObjectIds.Server)):
            event.emitting_node = emitting
            await trigger(event)
        return identifier

    # -- methods ----------------------------------------------------------------------------

    def _actor(self) -> Actor:
        """Return the caller, who may do what an operator does."""
        known = caller()
        actor = None if known is None else self._bench.present(known, "operator")
        if actor is None:
            raise InputError("nobody is signed in", "an account of this bench")
        return actor

    async def _acknowledge(self, parent: ua.NodeId, event_id: Any, comment: Any = None) -> Any:
        """Acknowledge the alarm of an event through the service, as the panel does."""
        found = next(
            (alarm for alarm, identifier in self._alarms.values() if identifier == event_id.Value),
            None,
        )
        if found is None or not event_id.Value or parent != self._space.alarm_id(found):
            return ua.StatusCode(ua.StatusCodes.BadEventIdUnknown)
        try:
            actor = self._actor()
        except TorquebenchError:
            return ua.StatusCode(ua.StatusCodes.BadUserAccessDenied)
        if found.acknowledged is not None:
            return ua.StatusCode(ua.StatusCodes.BadConditionBranchAlreadyAcked)
        try:
            cleared = await asyncio.to_thread(
                self._bench.acknowledge, actor, frozenset({found.alarm_id})
            )
        except TorquebenchError:
            return ua.StatusCode(ua.StatusCodes.BadInvalidState)
        words = getattr(getattr(comment, "Value", None), "Text", None)
        if words:
            self._bench.note(actor, "commented an alarm", number=found.number, comment=words[:200])
        await self._show_alarms()
        return [] if cleared is not None else ua.StatusCode(ua.StatusCodes.BadNothingToDo)

    def _result(self, record: ResultRecord | None) -> list[ua.Variant]:
        self._handles = self._handles % 0xFFFFFFFF + 1
        empty = ua.Variant(None, ua.VariantType.Null)
        data = empty if record is None else ua.Variant(self._space.result_data(record))
        error = NO_SUCH_RESULT if record is None else 0
        return [
            ua.Variant(0 if record is None else self._handles, ua.VariantType.UInt32),
            data,
            ua.Variant(error, ua.VariantType.Int32),
        ]

    async def _latest(self, _parent: ua.NodeId, _timeout: Any) -> Any:
        return self._result(self._records[0] if self._records else None)

    async def _by_id(self, _parent: ua.NodeId, result_id: Any, _timeout: Any) -> Any:
        wanted = (each for each in self._records if each.result_id == result_id.Value)
        return self._result(next(wanted, None))

    async def _filtered(
        self, _parent: ua.NodeId, wanted: Any, by: Any, most: Any, _timeout: Any
    ) -> Any:
        self._handles += 1
        try:
            paths = [path.Elements[-1].TargetName.Name for path in by.Value or []]
            found = ordered(self._records, _filter(wanted.Value), paths, int(most.Value or 0))
        except (TorquebenchError, AttributeError, IndexError, TypeError):
            return ua.StatusCode(ua.StatusCodes.BadInvalidArgument)
        names = [each.result_id for each in found]
        return [
            ua.Variant(self._handles, ua.VariantType.UInt32),
            ua.Variant(names, ua.VariantType.String, is_array=True),
            ua.Variant(0, ua.VariantType.Int32),
        ]

    async def _release(self, _parent: ua.NodeId, _handle: Any) -> Any:
        return [ua.Variant(0, ua.VariantType.Int32)]

    async def _acknowledged(self, _parent: ua.NodeId, result_ids: Any) -> Any:
        """Log that a client has acknowledged results."""
        try:
            actor = self._actor()
        except TorquebenchError:
            return ua.StatusCode(ua.StatusCodes.BadUserAccessDenied)
        names = [str(each) for each in result_ids.Value or []][:1000]
        known = {each.result_id for each in self._records}
        errors = [0 if each in known else NO_SUCH_RESULT for each in names]
        taken = [each for each in names if each in known]
        if taken:
            self._bench.note(actor, "took results over", results=", ".join(taken)[:2000])
        return [
            ua.Variant(errors if any(errors) else [], ua.VariantType.Int32, is_array=True),
            ua.Variant(NO_SUCH_RESULT if any(errors) else 0, ua.VariantType.Int32),
        ]

    async def _file(self, _parent: ua.NodeId, options: Any) -> Any:
        """Provide a result's file for reading."""
        result_id = getattr(options.Value, "ResultId", None)
        try:
            self._actor()
            content, name = await asyncio.to_thread(
                result_file, self._bench.records, str(result_id)
            )
        except TorquebenchError:
            return ua.StatusCode(ua.StatusCodes.BadNotFound)
        offered = await self._transfers.offer(name, content)
        if offered is None:
            return ua.StatusCode(ua.StatusCodes.BadTooManyOperations)
        node, handle = offered
        return [
            ua.Variant(node, ua.VariantType.NodeId),
            ua.Variant(handle, ua.VariantType.UInt32),
            ua.Variant(ua.NodeId(), ua.VariantType.NodeId),
        ]


def _filter(wanted: ua.ContentFilter | None) -> Condition | None:
    """Return a filter as a function of a result; the first element is its root."""
    elements = [] if wanted is None else list(wanted.Elements or [])
    if not elements:
        return None
    made: dict[int, Condition] = {}

    def element(number: int) -> Condition:
        if number not in made:
            each = elements[number]
            operands = [operand(item, number) for item in each.FilterOperands]
            made[number] = condition(each.FilterOperator.name, operands)
        return made[number]

    def operand(item: Any, above: int) -> Condition:
        if isinstance(item, ua.LiteralOperand):
            value = item.Value.Value
            return lambda _result: value
        if isinstance(item, ua.SimpleAttributeOperand):
            return field_value(item.BrowsePath[-1].Name)
        if isinstance(item, ua.ElementOperand) and item.Index > above:
            return element(item.Index)
        raise InputError("a filter's operand", "a literal, a field, or a later element")

    return element(0)


def _serial(name: str) -> str:
    """Return the bench's name as its serial number: letters, digits and hyphens."""
    return "-".join("".join(c if c.isalnum() else " " for c in name).split()) or "bench"
