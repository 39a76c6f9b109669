"""Files for clients: generated on request, removed when closed or unused."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

from asyncua import Node, Server, ua

from torquebench_opcua.access import caller
from torquebench_opcua.nodes import argument, at, typed_object

__all__ = ["Transfers"]

IDLE_S = 60.0
"""Time without access after which a file is removed, s: `ClientProcessingTimeout`."""
MOST_OPEN = 16
LONGEST_READ = 1 << 20
_BYTES, _UINT32, _UINT64, _BOOLEAN, _UINT16 = 15, 7, 9, 1, 5


@dataclass
class _Open:
    node: Node
    content: bytes
    owner: str
    position: int
    used: float


class Transfers:
    """Temporary files of an address space."""

    def __init__(self, server: Server, index: int) -> None:
        self._server = server
        self._index = index
        self._open: dict[int, _Open] = {}
        self._count = 0

    async def offer(self, name: str, content: bytes) -> tuple[ua.NodeId, int] | None:
        """Open a file for the caller; return None if too many files are open."""
        await self.forget()
        actor = caller()
        if len(self._open) >= MOST_OPEN or actor is None:
            return None
        self._count += 1
        handle = self._count

        def here(text: str) -> tuple[ua.NodeId, ua.QualifiedName]:
            return at(f"file.{handle}.{text}", self._index, text, 0)

        node = await typed_object(
            self._server.nodes.objects,
            *at(f"file.{handle}", self._index, name),
            ua.NodeId(ua.ObjectIds.FileType),
        )
        for text, value, kind in (
            ("Size", len(content), ua.VariantType.UInt64),
            ("Writable", False, ua.VariantType.Boolean),
            ("UserWritable", False, ua.VariantType.Boolean),
            ("OpenCount", 1, ua.VariantType.UInt16),
        ):
            await node.add_property(*here(text), value, kind)
        number = argument("fileHandle", _UINT32)
        place = argument("position", _UINT64)
        for text, method, given, returned in (
            ("Read", self._read, [number, argument("length", 6)], [argument("data", _BYTES)]),
            ("Close", self._close, [number], []),
            ("GetPosition", self._get_position, [number], [place]),
            ("SetPosition", self._set_position, [number, place], []),
        ):
            await node.add_method(*here(text), method, given, returned)
        self._open[handle] = _Open(node, content, actor.session_id, 0, time.monotonic())
        return node.nodeid, handle

    async def forget(self) -> None:
        """Remove files that clients have stopped reading."""
        old = time.monotonic() - IDLE_S
        for handle in [each for each, found in self._open.items() if found.used < old]:
            await self._remove(handle)

    async def _remove(self, handle: int) -> None:
        await self._server.delete_nodes([self._open.pop(handle).node], recursive=True)

    def _of_caller(self, parent: ua.NodeId, handle: Any) -> _Open | None:
        actor, found = caller(), self._open.get(handle.Value)
        if found is None or actor is None or found.owner != actor.session_id:
            return None
        if found.node.nodeid != parent:
            return None
        found.used = time.monotonic()
        return found

    async def _read(self, parent: ua.NodeId, handle: Any, length: Any) -> Any:
        file = self._of_caller(parent, handle)
        if file is None or not isinstance(length.Value, int) or length.Value < 0:
            return ua.StatusCode(ua.StatusCodes.BadInvalidArgument)
        end = file.position + min(length.Value, LONGEST_READ)
        part = file.content[file.position : end]
        file.position += len(part)
        return [ua.Variant(part, ua.VariantType.ByteString)]

    async def _close(self, parent: ua.NodeId, handle: Any) -> Any:
        if self._of_caller(parent, handle) is None:
            return ua.StatusCode(ua.StatusCodes.BadInvalidArgument)
        await self._remove(handle.Value)
        return []

    async def _get_position(self, parent: ua.NodeId, handle: Any) -> Any:
        file = self._of_caller(parent, handle)
        if file is None:
            return ua.StatusCode(ua.StatusCodes.BadInvalidArgument)
        return [ua.Variant(file.position, ua.VariantType.UInt64)]

    async def _set_position(self, parent: ua.NodeId, handle: Any, place: Any) -> Any:
        file = self._of_caller(parent, handle)
        if file is None or not isinstance(place.Value, int):
            return ua.StatusCode(ua.StatusCodes.BadInvalidArgument)
        file.position = min(max(place.Value, 0), len(file.content))
        return []
