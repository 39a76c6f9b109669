"""The address space: types by the companion specifications' names and numbers, and the bench.

The specifications' node sets aren't shipped. The parts that this server uses (identification and
state of OPC 40001-1, results of OPC 40001-101) are built here with their namespaces, browse names
and node numbers, so that clients of these specifications find them.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any

from asyncua import Node, Server, ua
from asyncua.common.structures104 import create_encoding, new_enum, new_struct_field

from torquebench import __version__
from torquebench.panel.service import AlarmView, BenchSnapshot, SideSnapshot
from torquebench_opcua.mapping import (
    EFFICIENCY,
    SIGNALS,
    LiveValue,
    MachineState,
    Signal,
    common_code,
)
from torquebench_opcua.results import EVALUATIONS, ResultRecord

__all__ = ["AddressSpace", "Method", "Methods", "argument", "at", "typed_object"]

DI = "http://opcfoundation.org/UA/DI/"
MACHINERY = "http://opcfoundation.org/UA/Machinery/"
RESULT = "http://opcfoundation.org/UA/Machinery/Result/"
STATES: dict[MachineState, int] = {
    "NotAvailable": 5005,
    "OutOfService": 5004,
    "NotExecuting": 5007,
    "Executing": 5006,
}
_STRING, _UTC_TIME, _TRIMMED, _HANDLE = 12, 294, 31918, 31917
_BASE_DATA = 24
_INT32, _UINT32, _BOOLEAN, _INT64, _TEXT, _NODE_ID, _BYTES = 6, 7, 1, 8, 21, 17, 15

_ABOUT = {
    "Simulated": (False, ua.VariantType.Boolean, "whether every value is simulated"),
    "Mounted": ("", ua.VariantType.String, "what is mounted between the flanges"),
    "JobId": ("", ua.VariantType.String, "job under way; empty without one"),
    "CommandedBy": ("", ua.VariantType.String, "who commands the bench; empty: nobody"),
    "ActiveAlarms": (0, ua.VariantType.UInt32, "number of active alarms and warnings"),
}
"""Variables of the bench with their first values and descriptions."""
_UNITS = "http://www.opcfoundation.org/UA/units/un/cefact"
_ANALOG_UNIT, _ANALOG_UNIT_RANGE = 17497, 17570
VALUES_OF = 20
"""Number of newest tests whose values are variables; every result contains its values."""

Method = Callable[..., Awaitable[Any]]


@dataclass(frozen=True)
class Methods:
    """Methods on results for clients; see `server`."""

    latest: Method
    by_id: Method
    filtered: Method
    release: Method
    acknowledge: Method
    generate_file: Method


@dataclass
class AddressSpace:
    """Nodes of the bench."""

    server: Server
    bench: Node
    index: int
    result_index: int
    state: Node
    state_id: Node
    live: dict[tuple[str, str], Node] = field(default_factory=dict)
    about: dict[str, Node] = field(default_factory=dict)
    results: Node | None = None
    management: Node | None = None
    types: dict[str, Any] = field(default_factory=dict)
    shown: dict[str, tuple[ResultRecord, Node]] = field(default_factory=dict)
    valued: dict[str, list[Node]] = field(default_factory=dict)
    alarms: dict[ua.NodeId, Node] = field(default_factory=dict)

    @classmethod
    async def build(
        cls, server: Server, uri: str, serial: str, bench: BenchSnapshot, methods: Methods
    ) -> AddressSpace:
        """Build everything; the bench's own nodes are in the namespace of the application."""
        spaces = {each: await server.register_namespace(each) for each in (DI, MACHINERY, RESULT)}
        index = await server.get_namespace_index(uri)
        machinery = spaces[MACHINERY]
        machines = await server.nodes.objects.add_folder(*at(1001, machinery, "Machines"))
        node = await machines.add_object(*at("bench", index, bench.bench_name))
        await node.set_event_notifier([ua.EventNotifier.SubscribeToEvents])
        await server.nodes.server.add_reference(node, ua.ObjectIds.HasNotifier)
        await _identification(server, node, spaces, index, uri, serial)
        state, state_id = await _state_machine(server, node, machinery, index)
        space = cls(server, node, index, spaces[RESULT], state, state_id)
        await space._live_values(bench)
        await space._result_types()
        await space._result_management(methods)
        return space

    # -- live values ------------------------------------------------------------------------

    async def _live_values(self, bench: BenchSnapshot) -> None:
        for name, side in bench.sides.items():
            folder = await self.bench.add_object(*at(name, self.index, name.capitalize()))
            await _describe(folder, f"the {name} module, transducer {side.transducer_serial}")
            for signal in SIGNALS:
                self.live[name, signal.name] = await self._measured(
                    folder, f"{name}.{signal.name}", signal, _range_of(signal, side)
                )
        self.live["", EFFICIENCY.name] = await self._measured(
            self.bench, EFFICIENCY.name, EFFICIENCY, (0.0, 100.0)
        )
        for about, (start, kind, description) in _ABOUT.items():
            self.about[about] = await self.bench.add_variable(
                *at(about, self.index, about), start, kind
            )
            await _describe(self.about[about], description)

    async def _measured(
        self, parent: Node, identifier: str, signal: Signal, limits: tuple[float, float] | None
    ) -> Node:
        node = await parent.add_variable(
            *at(identifier, self.index, signal.name), 0.0, ua.VariantType.Double
        )
        await _describe(node, signal.description)
        await self._unit(node, identifier, signal.unit)
        if limits is not None:
            await node.add_property(
                *at(f"{identifier}.EURange", self.index, "EURange", 0), ua.Range(*limits)
            )
        await _retype(node, _ANALOG_UNIT if limits is None else _ANALOG_UNIT_RANGE)
        return node

    async def _unit(self, node: Node, identifier: str, unit: str) -> None:
        information = ua.EUInformation(
            NamespaceUri=_UNITS,
            UnitId=common_code(unit),
            DisplayName=ua.LocalizedText(unit),
            Description=ua.LocalizedText(unit),
        )
        await node.add_property(
            *at(f"{identifier}.EngineeringUnits", self.index, "EngineeringUnits", 0), information
        )

    async def write_live(self, values: dict[tuple[str, str], LiveValue]) -> None:
        """Write live values with status and source time."""
        now = datetime.now(UTC)
        for key, shown in values.items():
            number = None if shown.value is None else float(shown.value)
            await self.server.write_attribute_value(
                self.live[key].nodeid,
                ua.DataValue(
                    ua.Variant(
                        number, ua.VariantType.Null if number is None else ua.VariantType.Double
                    ),
                    StatusCode=ua.StatusCode(getattr(ua.StatusCodes, shown.status)),
                    SourceTimestamp=shown.source_time or now,
                    ServerTimestamp=now,
                ),
            )

    async def write_about(self, values: dict[str, Any]) -> None:
        """Write the bench's variables other than live values, by their names."""
        for name, (_, kind, _description) in _ABOUT.items():
            await self.about[name].write_value(ua.Variant(values[name], kind))

    async def write_state(self, state: MachineState) -> None:
        """Write the machine's state."""
        machinery = await self.server.get_namespace_index(MACHINERY)
        await self.state.write_value(ua.LocalizedText(state, "en"))
        await self.state_id.write_value(ua.NodeId(STATES[state], machinery))

    # -- alarms -----------------------------------------------------------------------------

    def alarm_id(self, alarm: AlarmView) -> ua.NodeId:
        """Return the condition of an alarm."""
        return ua.NodeId(f"alarm.{alarm.alarm_id}", self.index)

    async def show_alarms(self, active: Sequence[AlarmView]) -> None:
        """Show these alarms as conditions of the bench, with events."""
        wanted = {self.alarm_id(each): each for each in active}
        for gone in [each for each in self.alarms if each not in wanted]:
            await self.server.delete_nodes([self.alarms.pop(gone)])
        for identifier, alarm in wanted.items():
            if identifier in self.alarms:
                continue
            node = await typed_object(
                self.bench,
                identifier,
                ua.QualifiedName(f"{alarm.kind} {alarm.number}", self.index),
                ua.NodeId(ua.ObjectIds.AlarmConditionType),
            )
            await node.add_reference(
                ua.NodeId(ua.ObjectIds.AcknowledgeableConditionType_Acknowledge),
                ua.ObjectIds.HasComponent,
                bidirectional=False,
            )
            self.alarms[identifier] = node

    # -- results ----------------------------------------------------------------------------

    async def _result_types(self) -> None:
        index, server = self.result_index, self.server
        enum = await new_enum(
            server, *at(3002, index, "ResultEvaluationEnum"),
            list(EVALUATIONS),
        )  # fmt: skip
        base = server.nodes.base_structure_type
        await self._structure(base, 3005, None, "BaseResultTransferOptionsDataType",
                              [_field("ResultId", _TRIMMED)])  # fmt: skip
        options = server.get_node(ua.NodeId(3005, index))
        await self._structure(options, 3004, 5001, "ResultTransferOptionsDataType",
                              [_field("ResultId", _TRIMMED)])  # fmt: skip
        optional = [
            ("HasTransferableDataOnFile", _BOOLEAN, False), ("IsPartial", _BOOLEAN, False),
            ("IsSimulated", _BOOLEAN, False), ("ResultState", _INT32, False),
            ("StepId", _TRIMMED, False), ("PartId", _TRIMMED, False),
            ("ExternalRecipeId", _TRIMMED, False), ("InternalRecipeId", _TRIMMED, False),
            ("ProductId", _TRIMMED, False), ("ExternalConfigurationId", _TRIMMED, False),
            ("InternalConfigurationId", _TRIMMED, False), ("JobId", _TRIMMED, False),
            ("CreationTime", _UTC_TIME, False), ("ProcessingTimes", ua.NodeId(3006, index), False),
            ("ResultUri", _STRING, True), ("ResultEvaluation", enum.nodeid, False),
            ("ResultEvaluationCode", _INT64, False), ("ResultEvaluationDetails", _TEXT, False),
            ("FileFormat", _STRING, True),
        ]  # fmt: skip
        await self._structure(base, 3006, 5003, "ProcessingTimesDataType", [
            _field("StartTime", _UTC_TIME), _field("EndTime", _UTC_TIME),
            _field("AcquisitionDuration", 290, optional=True),
            _field("ProcessingDuration", 290, optional=True),
        ])  # fmt: skip
        await self._structure(base, 3007, 5005, "ResultMetaDataType", [
            _field("ResultId", _TRIMMED),
            *(_field(name, kind, array=array, optional=True) for name, kind, array in optional),
        ])  # fmt: skip
        await self._structure(base, 3008, 5008, "ResultDataType", [
            _field("ResultMetaData", ua.NodeId(3007, index), optional=True),
            _field("ResultContent", _BASE_DATA, array=True),
        ])  # fmt: skip
        self.types = await server.load_data_type_definitions()
        objects = server.nodes.base_object_type
        await objects.add_object_type(*at(1004, index, "ResultManagementType"))
        transfer = server.get_node(ua.NodeId(ua.ObjectIds.TemporaryFileTransferType))
        await transfer.add_object_type(*at(1003, index, "ResultTransferType"))
        variable = server.get_node(ua.NodeId(ua.ObjectIds.BaseDataVariableType))
        await variable.add_variable_type(*at(2001, index, "ResultType"), ua.NodeId(3008, index))
        events = server.get_node(ua.NodeId(ua.ObjectIds.BaseEventType))
        ready = await events.add_object_type(*at(1002, index, "ResultReadyEventType"))
        await ready.add_variable(
            *at(6032, index, "Result"), None,
            ua.VariantType.ExtensionObject, ua.NodeId(3008, index),
        )  # fmt: skip

    async def _structure(
        self, parent: Node, number: int, encoding: int | None, name: str,
        fields: list[ua.StructureField],
    ) -> None:  # fmt: skip
        index = self.result_index
        node = await parent.add_data_type(*at(number, index, name))
        definition = ua.StructureDefinition()
        definition.BaseDataType = parent.nodeid
        definition.StructureType = (
            ua.StructureType.StructureWithOptionalFields
            if any(each.IsOptional for each in fields)
            else ua.StructureType.Structure
        )
        if name == "ResultDataType":  # its optional field may have subtypes: on the wire it is any
            definition.StructureType = ua.StructureType.StructureWithSubtypedValues
        definition.Fields = fields
        if encoding is not None:
            made = await create_encoding(node, *at(encoding, index, "Default Binary", 0))
            definition.DefaultEncodingId = made.nodeid
        await node.write_data_type_definition(definition)

    async def _result_management(self, methods: Methods) -> None:
        index = self.result_index

        def here(text: str, names: int = index) -> tuple[ua.NodeId, ua.QualifiedName]:
            return at(f"results.{text}", self.index, text, names)

        management = await typed_object(
            self.bench,
            *at("results", self.index, "ResultManagement", index),
            ua.NodeId(1004, index),
        )
        self.management = management
        data = argument("result", ua.NodeId(3008, index))
        handle, error = argument("resultHandle", _HANDLE), argument("error", _INT32)
        timeout = argument("timeout", _INT32)
        for text, method, given, returned in (
            ("GetLatestResult", methods.latest, [timeout], [handle, data, error]),
            (
                "GetResultById",
                methods.by_id,
                [argument("resultId", _TRIMMED), timeout],
                [handle, data, error],
            ),
            (
                "GetResultIdListFiltered",
                methods.filtered,
                [
                    argument("filter", 586),
                    argument("orderedBy", 540, array=True),
                    argument("maxResults", _UINT32),
                    timeout,
                ],
                [handle, argument("resultIdList", _TRIMMED, array=True), error],
            ),
            ("ReleaseResultHandle", methods.release, [handle], [error]),
            (
                "AcknowledgeResults",
                methods.acknowledge,
                [argument("resultIds", _TRIMMED, array=True)],
                [argument("errorPerResultId", _INT32, array=True), error],
            ),
        ):
            await management.add_method(*here(text), method, given, returned)
        self.results = await management.add_folder(*here("Results"))
        transfer = await typed_object(management, *here("ResultTransfer"), ua.NodeId(1003, index))
        await transfer.add_property(
            *here("ClientProcessingTimeout", 0), 60_000.0, ua.VariantType.Double, ua.NodeId(290)
        )
        await transfer.add_method(
            *here("GenerateFileForRead", 0), methods.generate_file,
            [argument("generateOptions", _BASE_DATA)],
            [argument("fileNodeId", _NODE_ID), argument("fileHandle", _UINT32),
             argument("completionStateMachine", _NODE_ID)],
        )  # fmt: skip

    def result_data(self, record: ResultRecord) -> Any:
        """Return a result as the specification's structure."""
        data = self.types["ResultDataType"]()
        data.ResultMetaData = self.result_meta(record)
        data.ResultContent = [
            ua.Variant(
                ua.KeyValuePair(ua.QualifiedName(name, self.index), ua.Variant(value)),
                ua.VariantType.ExtensionObject,
            )
            for each in record.quantities
            for name, value in (
                (each.key, each.value),
                (f"{each.key}.ExpandedUncertainty", each.expanded_uncertainty),
                (f"{each.key}.Limit", each.limit),
                (f"{each.key}.Verdict", each.verdict),
            )
            if value not in (None, "")
        ]
        return data

    def result_meta(self, record: ResultRecord) -> Any:
        """Return a result's metadata as the specification's structure."""
        meta = self.types["ResultMetaDataType"]()
        for each, value in record.field_values.items():
            setattr(meta, each, value)
        meta.ResultEvaluation = self.types["ResultEvaluationEnum"](meta.ResultEvaluation)
        meta.ResultEvaluationDetails = ua.LocalizedText(record.details, "en")
        return meta

    async def show_results(self, records: tuple[ResultRecord, ...]) -> list[ResultRecord]:
        """Show these results as variables; return those that are new, the oldest first."""
        wanted = {each.result_id: each for each in records}
        new = [each for each in reversed(records) if each.result_id not in self.shown]
        for result_id, (shown, node) in list(self.shown.items()):
            if wanted.get(result_id) != shown:  # gone, or a report was written since
                await self.server.delete_nodes([node], recursive=True)
                del self.shown[result_id]
                self.valued.pop(result_id, None)
        for record in reversed(records):
            if record.result_id not in self.shown:
                self.shown[record.result_id] = (record, await self._show_result(record))
        await self._show_values([each for each in records if each.quantities][:VALUES_OF])
        return new

    async def _show_result(self, record: ResultRecord) -> Node:
        assert self.results is not None
        identifier = f"result.{record.result_id}"
        node = await self.results.add_variable(
            *at(identifier, self.index, record.result_id),
            self.result_data(record),
            ua.VariantType.ExtensionObject,
            ua.NodeId(3008, self.result_index),
        )
        await _retype(node, ua.NodeId(2001, self.result_index))
        await _describe(node, f"{record.kind}: {record.details}".rstrip(": "))
        await node.add_variable(
            *at(f"{identifier}.ResultMetaData", self.index, "ResultMetaData", self.result_index),
            self.result_meta(record),
            ua.VariantType.ExtensionObject,
            ua.NodeId(3007, self.result_index),
        )
        return node

    async def _show_values(self, tests: Sequence[ResultRecord]) -> None:
        """Show the values of these tests as variables of their results, and of no others."""
        wanted = {each.result_id for each in tests}
        for result_id in [each for each in self.valued if each not in wanted]:
            await self.server.delete_nodes(self.valued.pop(result_id), recursive=True)
        for record in tests:
            if record.result_id not in self.valued:
                self.valued[record.result_id] = await self._show_quantities(record)

    async def _show_quantities(self, record: ResultRecord) -> list[Node]:
        nodes = []
        for each in record.quantities:
            identifier = f"result.{record.result_id}.{each.key}"
            node = await self.shown[record.result_id][1].add_variable(
                *at(identifier, self.index, each.key), each.value, ua.VariantType.Double
            )
            await _describe(node, each.title)
            await self._unit(node, identifier, each.unit)
            await _retype(node, _ANALOG_UNIT)
            for name, value in (
                ("ExpandedUncertainty", each.expanded_uncertainty),
                ("Limit", each.limit),
                ("Verdict", each.verdict),
            ):
                if value is not None:
                    await node.add_property(*at(f"{identifier}.{name}", self.index, name), value)
            nodes.append(node)
        return nodes


def _range_of(signal: Signal, side: SideSnapshot) -> tuple[float, float] | None:
    """Return the lowest and the largest value of a signal, None if there are none."""
    if not signal.largest:
        return None
    largest = float(getattr(side, signal.largest))
    return (0.0 if signal.smallest_is_zero else -largest), largest


async def _identification(
    server: Server, bench: Node, spaces: dict[str, int], index: int, uri: str, serial: str
) -> None:
    machinery, di = spaces[MACHINERY], spaces[DI]
    folder = server.get_node(ua.NodeId(ua.ObjectIds.FolderType))
    group = await folder.add_object_type(*at(1005, di, "FunctionalGroupType"))
    item = await group.add_object_type(*at(1004, machinery, "MachineryItemIdentificationType"))
    await item.add_object_type(*at(1012, machinery, "MachineIdentificationType"))
    node = await typed_object(
        bench, *at("identification", index, "Identification", di), ua.NodeId(1012, machinery)
    )
    text = ua.VariantType.LocalizedText
    for name, value, kind in (
        ("Manufacturer", ua.LocalizedText("torquebench"), text),
        ("Model", ua.LocalizedText("torque test bench"), text),
        ("SerialNumber", serial, ua.VariantType.String),
        ("ProductInstanceUri", uri, ua.VariantType.String),
        ("SoftwareRevision", __version__, ua.VariantType.String),
    ):
        await node.add_property(*at(f"identification.{name}", index, name, di), value, kind)


async def _state_machine(
    server: Server, bench: Node, machinery: int, index: int
) -> tuple[Node, Node]:
    finite = server.get_node(ua.NodeId(ua.ObjectIds.FiniteStateMachineType))
    kind = await finite.add_object_type(*at(1002, machinery, "MachineryItemState_StateMachineType"))
    for name, number in STATES.items():
        await kind.add_object(*at(number, machinery, name), ua.NodeId(ua.ObjectIds.StateType))
    node = await typed_object(
        bench, *at("state", index, "MachineryItemState", machinery), kind.nodeid
    )
    current = await node.add_variable(
        *at("state.CurrentState", index, "CurrentState", 0), ua.LocalizedText("NotAvailable", "en")
    )
    await _retype(current, ua.ObjectIds.FiniteStateVariableType)
    identifier = await current.add_property(
        *at("state.CurrentState.Id", index, "Id", 0),
        ua.NodeId(STATES["NotAvailable"], machinery),
    )
    return current, identifier


def at(
    identifier: str | int, index: int, name: str, names: int | None = None
) -> tuple[ua.NodeId, ua.QualifiedName]:
    """Return the identifier and the browse name of a node, of one namespace or of two."""
    return ua.NodeId(identifier, index), ua.QualifiedName(name, index if names is None else names)


async def typed_object(
    parent: Node, identifier: ua.NodeId, name: ua.QualifiedName, kind: ua.NodeId
) -> Node:
    """Add an object of a type without the type's children: the caller adds them."""
    node = await parent.add_object(identifier, name)
    await _retype(node, kind)
    return node


async def _retype(node: Node, kind: int | ua.NodeId) -> None:
    """Give a node another type."""
    wanted = ua.NodeId(kind) if isinstance(kind, int) else kind
    old = await node.read_type_definition()
    await node.delete_reference(old, ua.ObjectIds.HasTypeDefinition, bidirectional=False)
    await node.add_reference(wanted, ua.ObjectIds.HasTypeDefinition, bidirectional=False)


async def _describe(node: Node, text: str) -> None:
    """Give a node a description: the library's own repeats its name."""
    value = ua.Variant(ua.LocalizedText(text, "en"), ua.VariantType.LocalizedText)
    await node.write_attribute(ua.AttributeIds.Description, ua.DataValue(value))


def _field(
    name: str, kind: int | ua.NodeId, *, array: bool = False, optional: bool = False
) -> ua.StructureField:
    data_type = ua.NodeId(kind) if isinstance(kind, int) else kind
    return new_struct_field(name, data_type, array=array, optional=optional)


def argument(name: str, kind: int | ua.NodeId, *, array: bool = False) -> ua.Argument:
    """Return an argument of a method."""
    made = ua.Argument()
    made.Name = name
    made.DataType = ua.NodeId(kind) if isinstance(kind, int) else kind
    made.ValueRank = 1 if array else -1
    made.ArrayDimensions = [0] if array else []
    return made
