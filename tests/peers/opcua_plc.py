"""A PLC's OPC UA server (asyncua's own) with one variable a channel."""

import asyncio
import socket
import threading
from collections.abc import Callable
from types import TracebackType
from typing import Any, Self

from asyncua import Server, ua

NAMESPACE = "urn:peer-works:plc"


class PlcPeer:
    """Serves `values` at `address` and writes them every 10 ms, as a PLC's cycle does.

    A value of None is a variable whose quality is bad, as of a broken wire.
    """

    def __init__(self, values: dict[str, Callable[[], float | None]], port: int = 0) -> None:
        self.values = values
        if not port:
            with socket.create_server(("127.0.0.1", 0)) as free:
                port = free.getsockname()[1]
        self.port = port
        self.address = f"opc.tcp://127.0.0.1:{port}"
        self._loop = asyncio.new_event_loop()
        self._ready, self._ending = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        assert self._ready.wait(60.0)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._ending.set()
        self._thread.join()

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        self._loop.run_until_complete(self._serve())
        self._loop.close()

    async def _serve(self) -> None:
        server = Server()
        await server.init()
        server.set_endpoint(self.address)
        server.set_security_policy([ua.SecurityPolicyType.NoSecurity])
        index = await server.register_namespace(NAMESPACE)
        nodes: dict[str, Any] = {}
        for name in self.values:
            node = ua.NodeId(name, index)
            nodes[name] = await server.nodes.objects.add_variable(node, name, 0.0)
        async with server:
            self._ready.set()
            while not self._ending.is_set():
                for name, node in nodes.items():
                    value = self.values[name]()
                    bad = value is None
                    code = ua.StatusCodes.BadSensorFailure if bad else ua.StatusCodes.Good
                    stated = ua.Variant(0.0 if value is None else value, ua.VariantType.Double)
                    await node.write_value(ua.DataValue(stated, ua.StatusCode(code)))
                await asyncio.sleep(0.01)
