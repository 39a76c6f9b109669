"""Read a bench as an independent OPC UA stack does, and print what it found as JSON.

Arguments: URL, the server's certificate, folder with client.der and key.pem, application URI, user,
password, identifier of a result with a file, the server's application URI, a reducer test. A
process of its own: o6 ends its process after ten minutes.
"""

import hashlib
import json
import struct
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import o6
from o6.ns import machinery, machinery_result, ns0

POLICY = "http://opcfoundation.org/UA/SecurityPolicy#Basic256Sha256"
MACHINES = f"nsu={machinery.uri};i=1001"
SERVER, NAMESPACES = "i=2253", "i=2255"
CONDITION_REFRESH = ("i=2782", "i=3875")  # ConditionType and its method
ACKNOWLEDGE = "i=9111"
TRANSFER_OPTIONS = 5001  # binary encoding of ResultTransferOptionsDataType
NODE = "i=2782#NodeId"  # the condition itself
EVENTS = f"SELECT /EventId, /Message, /Severity, /Retain, /ActiveState/Id, /AckedState/Id, {NODE}"


def node(name: str) -> str:
    return f"nsu={sys.argv[8]};s={name}"


def word(status: Any) -> str:
    """Return a status code's name as the specification writes it."""
    return "".join(part.capitalize() for part in o6.StatusCode(status).name.split("_"))


def read(client: Any, name: str) -> Any:
    both = ns0.datatypes.TimestampsToReturn.BOTH
    return client.read(node(name), valueOnly=False, timestampsToReturn=both)


def call(client: Any, on: str, method: str, *given: Any) -> tuple[str, tuple[Any, ...]]:
    status, *out = client.call(on, method, list(given))
    return word(status), tuple(out)


def values(client: Any) -> dict[str, Any]:
    found = client.browse(MACHINES, resultMask=ns0.datatypes.BrowseResultMask.ALL)
    raw = read(client, "output.RawTorque")
    limits = read(client, "output.RawTorque.EURange").value
    return {
        "machines": [str(each.browseName.name) for each in found],
        "serial": str(read(client, "identification.SerialNumber").value),
        "state": str(read(client, "state.CurrentState").value.text),
        "raw": {
            "value": float(raw.value),
            "status": word(raw.status),
            "time": str(raw.sourceTimestamp),
        },
        "torqueStatus": word(read(client, "output.Torque").status),
        "unit": str(read(client, "output.RawTorque.EngineeringUnits").value.displayName.text),
        "range": [float(getattr(limits, name)) for name in ("low", "high")],
        "uris": [str(each) for each in client.read(NAMESPACES)][1:2],
        "write": word(client.write(node("output.RawTorque"), o6.Double(1.0))),
    }


def transfer_options(client: Any, result: str) -> Any:
    """Return the method's structure; o6 doesn't translate its namespace number to the server's."""
    options = machinery_result.datatypes.ResultTransferOptionsDataType(resultId=result)
    body = o6.encodeBinary(options)
    there = [str(each) for each in client.read(NAMESPACES)].index(machinery_result.uri)
    head = struct.pack("<BHIBi", 2, there, TRANSFER_OPTIONS, 1, len(body))
    return o6.decodeBinary(head + body, o6.ExtensionObject)


def results(client: Any, result: str) -> dict[str, Any]:
    there, zero = node("results"), o6.Int32(0)
    latest, newest = call(client, there, node("results.GetLatestResult"), zero)
    found, named = call(client, there, node("results.GetResultById"), result, zero)
    meta = o6.decodeBinary(
        bytes(read(client, f"result.{result}.ResultMetaData").value.body),
        machinery_result.datatypes.ResultMetaDataType,
    )
    offered, out = call(
        client,
        node("results.ResultTransfer"),
        node("results.GenerateFileForRead"),
        transfer_options(client, result),
    )
    file, handle = str(out[0]), o6.UInt32(out[1])
    content = b""
    while part := bytes(call(client, file, f"{file}.Read", handle, o6.Int32(65536))[1][0]):
        content += part
    return {
        "latest": {"status": latest, "error": int(newest[2])},
        "byId": {"status": found, "error": int(named[2])},
        "result": {
            "id": str(meta.resultId),
            "format": [str(each) for each in meta.fileFormat],
            "part": str(meta.partId),
            "simulated": bool(meta.isSimulated),
        },
        "offered": offered,
        "file": hashlib.sha256(content).hexdigest(),
        "closed": call(client, file, f"{file}.Close", handle)[0],
        "afterClose": call(client, file, f"{file}.Read", handle, o6.Int32(1))[0],
    }


def tested(client: Any, run_id: str) -> dict[str, Any]:
    """Read the values of a reducer test, and the test's content by a method."""
    value = read(client, f"result.{run_id}.backlash")
    limit = read(client, f"result.{run_id}.backlash.Limit")
    meta = o6.decodeBinary(
        bytes(read(client, f"result.{run_id}.ResultMetaData").value.body),
        machinery_result.datatypes.ResultMetaDataType,
    )
    status, _ = call(client, node("results"), node("results.GetResultById"), run_id, o6.Int32(0))
    return {
        "byId": status,
        "backlash": float(value.value),
        "limit": str(limit.value),
        "part": str(meta.partId),
        "evaluation": int(meta.resultEvaluation),
        "details": str(meta.resultEvaluationDetails.text),
    }


def conditions(client: Any) -> dict[str, Any]:
    """Refresh, acknowledge, and wait for the event of the acknowledged alarm."""
    events: list[dict[str, Any]] = []
    client.monitorEvent(SERVER, events.append, EVENTS)
    number = o6.UInt32(client.defaultSubscription.id)
    said: dict[str, Any] = {"refreshed": call(client, *CONDITION_REFRESH, number)[0]}

    def wait(wanted: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        for _ in range(1200):
            if found := next(filter(wanted, list(events)), None):
                return found
            time.sleep(0.1)
        raise TimeoutError(f"no such event, only {events}")

    alarm = wait(lambda each: bool(each["/Retain"]) and bool(each["/ActiveState/Id"]))
    said["alarm"] = {
        "message": str(alarm["/Message"].text),
        "severity": int(alarm["/Severity"]),
        "acknowledged": bool(alarm["/AckedState/Id"]),
    }
    comment = o6.LocalizedText("seen by the plant")
    said["acknowledge"], _ = call(client, alarm[NODE], ACKNOWLEDGE, alarm["/EventId"], comment)
    cleared = wait(lambda each: each["/Retain"] is not None and not each["/Retain"])
    said["cleared"] = bool(cleared["/AckedState/Id"])
    return said


def main(
    url: str,
    server: str,
    folder: str,
    application: str,
    user: str,
    password: str,
    result: str,
    _uri: str,
    run_id: str,
) -> dict[str, Any]:
    client = o6.Client(
        url,
        certificate=Path(folder, "client.der"),
        privateKey=Path(folder, "key.pem"),
        trustList=[Path(server)],
        securityMode=ns0.datatypes.MessageSecurityMode.SIGN_AND_ENCRYPT,
        securityPolicy=POLICY,
        applicationUri=application,
        username=user,
        password=password,
    )
    try:
        client.connect()
    except o6.StatusCodeError as error:
        return {"refused": word(error.code)}
    try:
        found = {**values(client), **results(client, result), **conditions(client)}
        return {**found, "test": tested(client, run_id)}
    finally:
        client.disconnect()


if __name__ == "__main__":
    print(json.dumps(main(*sys.argv[1:])))
