"""The server of the control channel: lines of JSON, see `bench.drivers.simulation_control`.

Requests: `{"do": "status"}`, `{"do": "mount", "mounting": "calibrator"}`, `{"do": "seat"}`, `{"do":
"misbehave", "endpoint": "input_drive", "kind": "drop", "replies": 3}` (and `amount`, `duration_s`),
`{"do": "heal"}` (and `endpoint`), `{"do": "fault", "channel": "output_torque", "kind": "silent",
"duration_s": 0.2}` (and `amount`; of the signal itself, in bench time), `{"do": "truth", "side":
"output"}` (mean true torque in N·m, over the last 0.1 s or from `start_s` to `stop_s` of the
client's bench time), `{"do": "sweep", "side": "output", "torque_nm": [...]}` (noise-free readings
along a path), `{"do": "certificates"}` (of the simulated calibrator), `{"do":
"encoder_certificates"}`, `{"do": "reducer_certificate"}`, `{"do": "mounting"}` (the record of the
mounting), `{"do": "supply", "on": false}` (of the drives), `{"do": "drive_log", "side": "output"}`
(commands and reactions of that drive with its set points, in the plant's time). Every answer is an
object, with `error` if the request fails.
"""

from __future__ import annotations

import contextlib
import json
import random
import socket
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from torquebench.bench.roles import SIDES
from torquebench.errors import TorquebenchError
from torquebench.simulators.line_server import LineServer
from torquebench.simulators.misbehaviour import Misbehaviour, WireFaults
from torquebench.simulators.plant import Plant

TRUTH_WINDOW_S = 0.1


def _refuse(constant: str) -> float:
    raise ValueError(f"{constant} is no number")


class ControlServer(LineServer):
    """Server that mounts objects, and injects and repairs faults.

    Parameters
    ----------
    host, port
        With port 0, a free port is chosen, which `port` then holds.
    """

    def __init__(self, plant: Plant, misbehaviour: Misbehaviour, host: str, port: int) -> None:
        self._plant = plant
        self._misbehaviour = misbehaviour
        self._actions: dict[str, Callable[[Mapping[str, Any]], dict[str, Any]]] = {
            "status": self._status,
            "mount": self._mount,
            "seat": self._seat,
            "misbehave": self._misbehave,
            "heal": self._heal,
            "fault": self._fault,
            "truth": self._truth,
            "sweep": self._sweep,
            "certificates": self._certificates,
            "encoder_certificates": self._encoder_certificates,
            "reducer_certificate": self._reducer_certificate,
            "drive_log": self._drive_log,
            "supply": self._supply,
            "mounting": self._mounting,
        }
        super().__init__(WireFaults("control", random.Random(0)), host, port)

    def attend(self, connection: socket.socket) -> None:
        """Answer one client until it disconnects."""
        with contextlib.suppress(OSError), connection.makefile("rb") as lines:
            for line in lines:
                connection.sendall(json.dumps(self._answer(line)).encode() + b"\n")

    def _answer(self, line: bytes) -> dict[str, Any]:
        """Return the answer to a request line; an error is an answer, too."""
        try:
            request = json.loads(line, parse_constant=_refuse)
            action = self._actions.get(request.get("do"))
            if action is None:
                return {"error": "unknown request; known: " + ", ".join(self._actions)}
            with self._plant.lock:
                return action(request)
        except TorquebenchError as error:
            return {"error": str(error)}
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            return {"error": f"{type(error).__name__}: {error}"}

    def _status(self, request: Mapping[str, Any]) -> dict[str, Any]:
        """Return the state of plant, drives and endpoints."""
        del request
        bench = self._plant.bench
        drives = {}
        for side, drive in bench.drives.items():
            state = drive.state()
            drives[side] = {
                "enabled": state.enabled,
                "torque_nm": state.torque_nm,
                "speed_rad_s": state.speed_rad_s,
                "fault": state.fault,
            }
        return {
            "time_s": self._plant.now_s,
            "preset": bench.options.preset,
            "seed": bench.options.seed,
            "time": self._plant.time,
            "mounted": bench.mounted(),
            "clamped": bench.clamped(),
            "rail": bench.position(),
            "supplied": bench.supplies(),
            "modes": {side: bench.mode(side) for side in SIDES},
            "drives": drives,
            "endpoints": list(self._misbehaviour.endpoints),
        }

    def _drive_log(self, request: Mapping[str, Any]) -> dict[str, Any]:
        log = self._plant.bench.drives[request["side"]].log
        return {"time_s": self._plant.now_s, "events": [event._asdict() for event in log]}

    def _mounting(self, request: Mapping[str, Any]) -> dict[str, Any]:
        del request
        return dict(self._plant.bench.mounting())

    def _supply(self, request: Mapping[str, Any]) -> dict[str, Any]:
        self._plant.bench.switch_supply(bool(request["on"]))
        return {"on": self._plant.bench.supplies()}

    def _mount(self, request: Mapping[str, Any]) -> dict[str, Any]:
        self._plant.bench.mount(request["mounting"])
        return {"mounted": self._plant.bench.mounted()}

    def _seat(self, request: Mapping[str, Any]) -> dict[str, Any]:
        """Mount anew what is mounted: it seats differently."""
        del request
        bench = self._plant.bench
        mounted = bench.mounted()
        bench.mount("nothing")
        bench.mount(mounted)
        return {"mounted": mounted}

    def _misbehave(self, request: Mapping[str, Any]) -> dict[str, Any]:
        """Start a misbehaviour at an endpoint."""
        self._misbehaviour.start(
            request["endpoint"],
            request["kind"],
            amount=request.get("amount"),
            replies=request.get("replies"),
            duration_s=request.get("duration_s"),
        )
        return {}

    def _heal(self, request: Mapping[str, Any]) -> dict[str, Any]:
        self._misbehaviour.heal(request.get("endpoint"))
        return {}

    def _fault(self, request: Mapping[str, Any]) -> dict[str, Any]:
        """Start a fault of a channel."""
        self._plant.bench.twin.inject_fault(
            request["channel"],
            request["kind"],
            duration_s=float(request.get("duration_s", 0.05)),
            amount=request.get("amount"),
        )
        return {}

    def _truth(self, request: Mapping[str, Any]) -> dict[str, Any]:
        """Return the true torque of a side over an interval of bench time."""
        epoch_s, now_s = self._plant.epoch_s, self._plant.now_s
        start_s = epoch_s + request.get("start_s", now_s - epoch_s - TRUTH_WINDOW_S)
        stop_s = epoch_s + request.get("stop_s", now_s - epoch_s)
        torque = self._plant.bench.true_torque(request["side"], max(0.0, start_s), stop_s)
        return {"torque_nm": torque, "time_s": now_s - epoch_s}

    def _sweep(self, request: Mapping[str, Any]) -> dict[str, Any]:
        """Return noise-free readings along a path of torques."""
        path = np.array(request["torque_nm"], dtype=np.float64)
        reading, branch = self._plant.bench.dense_sweep(
            request["side"], path, alone=bool(request.get("alone", False))
        )
        return {"reading_nm": reading.tolist(), "branch": branch.tolist()}

    def _certificates(self, request: Mapping[str, Any]) -> dict[str, Any]:
        """Return the certificates of the mountable standards."""
        del request
        return {
            mounting: {
                side: {
                    "torque_nm": certificate.torque_nm.tolist(),
                    "error_nm": certificate.error_nm.tolist(),
                    "expanded_uncertainty_nm": certificate.expanded_uncertainty_nm.tolist(),
                }
                for side, certificate in sides.items()
            }
            for mounting, sides in self._plant.bench.certificates().items()
        }

    def _reducer_certificate(self, request: Mapping[str, Any]) -> dict[str, Any]:
        del request
        points = self._plant.bench.reducer_certificate()
        return {"points": [point.model_dump() for point in points]}

    def _encoder_certificates(self, request: Mapping[str, Any]) -> dict[str, Any]:
        """Return the certificates of the encoders."""
        del request
        return {
            side: {
                "angle_rad": certificate.angle_rad.tolist(),
                "error_rad": certificate.error_rad.tolist(),
                "expanded_uncertainty_rad": certificate.expanded_uncertainty_rad.tolist(),
            }
            for side, certificate in self._plant.bench.encoder_certificates().items()
        }
