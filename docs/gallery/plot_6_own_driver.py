"""
A driver for an in-house instrument
===================================

A driver is a class with the methods of its role, and a plugin that opens it. This one reads
temperature probes of an instrument that answers ``T1?`` with a number. The instrument is simulated
by a thread behind a socket.
"""

# %%
# The instrument:
import socket
import socketserver
import threading


class Instrument(socketserver.StreamRequestHandler):
    """Answers T1? and T2? in °C."""

    def handle(self):
        for line in self.rfile:
            answers = {b"T1?": b"23.41", b"T2?": b"24.06"}
            self.wfile.write(answers.get(line.strip(), b"ERROR") + b"\n")


class Server(socketserver.ThreadingTCPServer):
    """Serves until the process ends."""

    daemon_threads = True


server = Server(("127.0.0.1", 0), Instrument)
threading.Thread(target=server.serve_forever, daemon=True).start()
address = "{}:{}".format(*server.server_address)

# %%
# The driver. Every call has a time limit, a wrong answer is an error with found, allowed and
# remedy, and closing twice does nothing.
from torquebench.bench.drivers.base import Identity
from torquebench.bench.drivers.plugins import DriverPlugin, InstrumentRequest, Options
from torquebench.errors import BenchError


class ProbeOptions(Options):
    """Keys of ``[driver.temperature]``."""

    address: str
    timeout_s: float = 0.5


class Probes:
    """Two probes."""

    def __init__(self, options):
        host, _, port = options.address.rpartition(":")
        self._socket = socket.create_connection((host, int(port)), options.timeout_s)
        self._lock = threading.Lock()

    def identity(self):
        """Return what the instrument is."""
        return Identity("in-house", "probes", "1")

    def temperatures(self):
        """Return the temperature of every probe, °C; a probe without an answer is missing."""
        return {"ambient": self._ask("T1?"), "output": self._ask("T2?")}

    def close(self):
        """Close the connection."""
        self._socket.close()

    def _ask(self, command):
        with self._lock:
            self._socket.sendall(f"{command}\n".encode())
            answer = self._socket.recv(64).decode().strip()
        try:
            return float(answer)
        except ValueError:
            raise BenchError(
                f"{command} answered {answer!r}", "a number", "check the probe's cable"
            ) from None


def open_probes(request: InstrumentRequest):
    """Open the probes of a bench description."""
    return Probes(request.read(ProbeOptions))


PLUGIN = DriverPlugin("in-house", {"temperature": open_probes})

# %%
# The bench opens it by the plugin, once the package announces ``PLUGIN`` in the entry-point group
# ``torquebench.drivers``. Here the opener is called directly.
from torquebench.bench import default_bench

options = {"address": address}
request = InstrumentRequest("temperature", "driver.temperature", options, default_bench())
probes = PLUGIN.openers["temperature"](request)
print(probes.temperatures())

# %%
# A key that is misspelt is named before anything is opened:
from torquebench.errors import InputError

wrong = InstrumentRequest(
    "temperature", "driver.temperature", {**options, "timout_s": 1.0}, default_bench()
)
try:
    PLUGIN.openers["temperature"](wrong)
except InputError as error:
    print(error.found)
probes.close()
server.shutdown()
server.server_close()
