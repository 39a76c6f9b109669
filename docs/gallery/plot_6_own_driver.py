"""
A driver for an in-house instrument
===================================

A driver is a class with the methods of its role, and a plugin that opens it. This one reads
temperature probes of an instrument that answers ``T1?`` with a number. The instrument is simulated
by a thread behind a socket.
"""

# %%
# The instrument:
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
# The driver. `LineLink` waits for whole lines, has a time limit, connects again and repeats a
# question once. A probe without a valid answer is missing, and never an old value.
import contextlib

from torquebench.bench.drivers.base import Identity
from torquebench.bench.drivers.lines import LineLink, LineOptions
from torquebench.bench.drivers.links import WireError
from torquebench.bench.drivers.plugins import DriverPlugin, InstrumentRequest
from torquebench.errors import BenchError


class ProbeOptions(LineOptions):
    """Keys of ``[driver.temperature]``."""

    timeout_s: float = 0.5


class Probes(LineLink):
    """Two probes."""

    def __init__(self, options):
        super().__init__("probes", options, options.timeout_s)

    def identity(self):
        """Return what the instrument is."""
        return Identity("temperature", "in-house", "probes", "1")

    def temperatures(self):
        """Return the temperature of every probe, °C."""
        found = {}
        for name, command in (("ambient", "T1?"), ("output", "T2?")):
            with contextlib.suppress(BenchError):
                found[name] = self.call(lambda line, command=command: ask(line, command))
        return found


def ask(connection, command):
    """Return the number that answers a command; another answer is asked for again."""
    connection.send(command)
    answer = connection.receive(0.5)
    try:
        return float(answer)
    except ValueError:
        raise WireError(f"{command} is answered with {answer!r}") from None


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
