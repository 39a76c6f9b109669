"""The control channel of simulators: lines of JSON over TCP, one answer for each request.

It performs actions that instruments can't: it mounts objects between the flanges, and breaks and
repairs wires. A bench of real instruments never opens it.
"""

from __future__ import annotations

import json
import socket
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torquebench.bench.certificates.encoder import EncoderCertificate
from torquebench.bench.certificates.torque import ReferenceCertificate
from torquebench.bench.drivers.links import Link, WireError, split_address
from torquebench.bench.roles import MOUNTINGS, SIDES, Mounting, Seating, Side
from torquebench.errors import BenchError, InterlockError
from torquebench.message import Message
from torquebench.reducers import CertifiedFriction

LONGEST_LINE = 1_000_000


class SimulationControl(Link[socket.socket]):
    """A client of the simulators' control channel.

    Parameters
    ----------
    address : str
        `host:port`.
    """

    def __init__(self, address: str, timeout_s: float = 10.0) -> None:
        super().__init__("simulation control", address, timeout_s, attempts=1)

    def _open(self) -> socket.socket:
        connection = socket.create_connection(split_address(self.address), self.timeout_s)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return connection

    def _close(self, connection: socket.socket) -> None:
        connection.close()

    def ask(self, request: str, **arguments: Any) -> dict[str, Any]:
        """Send a request and return its answer.

        Raises
        ------
        BenchError
            The simulators don't answer, or refuse the request.
        """
        line = json.dumps({"do": request, **arguments}).encode() + b"\n"

        def exchange(connection: socket.socket) -> bytes:
            """Send the request and return the line that answers it."""
            connection.sendall(line)
            answer = b""
            while not answer.endswith(b"\n"):
                part = connection.recv(65536)
                if not part or len(answer) > LONGEST_LINE:
                    raise WireError("the connection was closed")
                answer += part
            return answer

        answer: dict[str, Any] = json.loads(self.call(exchange))
        if "error" in answer:
            raise BenchError(
                Message("the simulators refuse {request!r}: {error}", request, answer["error"])
            )
        return answer


class SimulatedTruth:
    """The torque that really acts in the simulation; see `drivers.base.TrueTorqueSource`."""

    def __init__(self, control: SimulationControl) -> None:
        self._control = control

    def true_torque(self, side: Side, start_s: float, stop_s: float) -> float:
        """Mean true torque at the flange over a time window, N·m."""
        answer = self._control.ask("truth", side=side, start_s=start_s, stop_s=stop_s)
        return float(answer["torque_nm"])

    def dense_sweep(
        self, side: Side, true_torque_nm: NDArray[np.float64], *, alone: bool = False
    ) -> tuple[NDArray[np.float64], NDArray[np.int8]]:
        """Noise-free readings along a path of true torques, and the branch of each point."""
        answer = self._control.ask(
            "sweep", side=side, torque_nm=true_torque_nm.tolist(), alone=alone
        )
        reading = np.array(answer["reading_nm"], dtype=np.float64)
        return reading, np.array(answer["branch"], dtype=np.int8)

    def mounting(self) -> dict[str, float | str]:
        """Request the record of the mounting."""
        return self._control.ask("mounting")


def simulated_certificates(
    control: SimulationControl,
) -> dict[Mounting, dict[Side, ReferenceCertificate]]:
    """Request the certificates of the simulated standards."""
    answer = control.ask("certificates")
    return {
        mounting: {
            side: ReferenceCertificate(**_arrays(answer[mounting][side]))
            for side in SIDES
            if side in answer[mounting]
        }
        for mounting in MOUNTINGS
        if mounting in answer
    }


def simulated_encoder_certificates(control: SimulationControl) -> dict[Side, EncoderCertificate]:
    """Request the certificates of the simulated encoders."""
    answer = control.ask("encoder_certificates")
    return {side: EncoderCertificate(**_arrays(answer[side])) for side in SIDES if side in answer}


def simulated_reducer_certificate(control: SimulationControl) -> tuple[CertifiedFriction, ...]:
    """Request the certified friction of the simulated reducer."""
    points = control.ask("reducer_certificate")["points"]
    return tuple(CertifiedFriction.model_validate(point) for point in points)


def _arrays(columns: Mapping[str, list[float]]) -> dict[str, NDArray[np.float64]]:
    return {name: np.array(values, dtype=np.float64) for name, values in columns.items()}


class SimulatedOperator:
    """The operator of a bench of simulators, who confirms every request at once."""

    def __init__(self, control: SimulationControl) -> None:
        self._control = control
        self._mounted: Mounting | None = None

    def mount(self, mounting: Mounting) -> None:
        """Mount this part between the flanges of the simulated bench."""
        try:
            self._control.ask("mount", mounting=mounting)
        except BenchError as error:
            raise InterlockError(error.found, error.allowed, error.remedy) from error
        self._mounted = mounting

    def mounted(self) -> Mounting:
        """Return the mounting between the flanges."""
        if self._mounted is None:
            self._mounted = self._control.ask("status")["mounted"]
        return self._mounted

    def seat(self, seating: Seating) -> None:
        """Re-seat the mounted part."""
        del seating
        self._control.ask("seat")

    def cancel(self) -> None:
        """Do nothing: nobody waits for the simulated operator."""
