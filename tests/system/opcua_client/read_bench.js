// Reads a bench as an independent OPC UA client does, and prints what it found as JSON.
// Arguments: URL, folder of its certificates, user, password, identifier of a result with a file.
const [, , url, folder, userName, password, resultId] = process.argv;
const path = require("node:path");
const {
  AttributeIds, DataType, MessageSecurityMode, OPCUAClient, SecurityPolicy, TimestampsToReturn,
  SimpleAttributeOperand, UserTokenType, coerceNodeId, constructEventFilter,
  promoteOpaqueStructure, resolveNodeId,
} = require("node-opcua-client");
const { OPCUACertificateManager } = require("node-opcua-certificate-manager");

async function main() {
  const said = {};
  const manager = new OPCUACertificateManager({
    rootFolder: path.join(folder, "pki"), automaticallyAcceptUnknownCertificate: true,
  });
  await manager.initialize();
  const client = OPCUAClient.create({
    applicationName: "reader", clientCertificateManager: manager, endpointMustExist: false,
    securityMode: MessageSecurityMode.SignAndEncrypt, securityPolicy: SecurityPolicy.Basic256Sha256,
    connectionStrategy: { maxRetry: 0 },
  });
  await client.createDefaultCertificate?.();
  await client.connect(url);
  let session;
  try {
    session = await client.createSession({ type: UserTokenType.UserName, userName, password });
  } catch (error) {
    await client.disconnect();
    return { refused: String(error.message) };
  }
  const spaces = await session.readNamespaceArray();
  const bench = spaces.indexOf("urn:torquebench:bench:nodes");
  const machinery = spaces.indexOf("http://opcfoundation.org/UA/Machinery/");
  const result = spaces.indexOf("http://opcfoundation.org/UA/Machinery/Result/");
  const node = (name) => `ns=${bench};s=${name}`;
  const value = async (name) => session.read({ nodeId: node(name), attributeId: AttributeIds.Value });

  const machines = await session.browse(`ns=${machinery};i=1001`);
  said.machines = machines.references.map((each) => each.browseName.name);
  said.serial = (await value("identification.SerialNumber")).value.value;
  said.state = (await value("state.CurrentState")).value.value.text;
  const raw = await value("output.RawTorque");
  said.raw = { value: raw.value.value, status: raw.statusCode.name, time: raw.sourceTimestamp };
  said.torqueStatus = (await value("output.Torque")).statusCode.name;
  const unit = await value("output.RawTorque.EngineeringUnits");
  said.unit = unit.value.value.displayName.text;
  const written = await session.write({
    nodeId: node("output.RawTorque"), attributeId: AttributeIds.Value,
    value: { value: { dataType: DataType.Double, value: 1 } },
  });
  said.write = written.name;

  // results
  const call = async (method, inputArguments, objectId = node("results")) => {
    const done = await session.call({ objectId, methodId: node(method), inputArguments });
    const out = done.outputArguments || [];
    return { status: done.statusCode.name, out: out.map((each) => each.value) };
  };
  const zero = { dataType: DataType.Int32, value: 0 };
  const latest = await call("results.GetLatestResult", [zero]);
  said.latest = { status: latest.status, error: latest.out[2] };
  if (resultId) {
    const named = { dataType: DataType.String, value: resultId };
    const found = await call("results.GetResultById", [named, zero]);
    said.byId = { status: found.status, error: found.out[2] };
    const shown = await value(`result.${resultId}.ResultMetaData`);
    await promoteOpaqueStructure(session, [shown]);
    const meta = shown.value.value;
    said.result = {
      id: meta.resultId, format: meta.fileFormat, part: meta.partId,
      simulated: meta.isSimulated, file: meta.hasTransferableDataOnFile,
    };
    const options = await session.constructExtensionObject(
      coerceNodeId(`ns=${result};i=3004`), { resultId });
    const offered = await call(
      "results.GenerateFileForRead",
      [{ dataType: DataType.ExtensionObject, value: options }], node("results.ResultTransfer"));
    said.offered = offered.status;
    const [file, handle] = offered.out;
    const part = async (name, more) => session.call({
      objectId: file, methodId: `${file.toString()}.${name}`,
      inputArguments: [{ dataType: DataType.UInt32, value: handle }, ...more],
    });
    const parts = [];
    for (;;) {
      const read = await part("Read", [{ dataType: DataType.Int32, value: 65536 }]);
      const bytes = read.outputArguments[0].value;
      if (!bytes || bytes.length === 0) break;
      parts.push(bytes);
    }
    said.file = require("node:crypto").createHash("sha256").update(Buffer.concat(parts)).digest("hex");
    said.closed = (await part("Close", [])).statusCode.name;
    const again = await part("Read", [{ dataType: DataType.Int32, value: 1 }]);
    said.afterClose = again.statusCode.name;
  }

  // conditions: refresh, acknowledge, and the event of the acknowledged one
  const subscription = await session.createSubscription2({
    requestedPublishingInterval: 50, requestedLifetimeCount: 1000, requestedMaxKeepAliveCount: 10,
    publishingEnabled: true,
  });
  const fields = ["EventId", "Message", "Severity", "Retain", "ActiveState.Id", "AckedState.Id"];
  const filter = constructEventFilter(fields, undefined);
  filter.selectClauses.push(new SimpleAttributeOperand({
    typeDefinitionId: resolveNodeId("ConditionType"), browsePath: [], attributeId: AttributeIds.NodeId,
  }));
  const events = [];
  const item = await subscription.monitor(
    { nodeId: resolveNodeId("Server"), attributeId: AttributeIds.EventNotifier },
    { queueSize: 100, discardOldest: true, filter }, TimestampsToReturn.Both);
  item.on("changed", (each) => events.push(each.map((variant) => variant.value)));
  await session.call({
    objectId: resolveNodeId("ConditionType"), methodId: resolveNodeId("ConditionType_ConditionRefresh"),
    inputArguments: [{ dataType: DataType.UInt32, value: subscription.subscriptionId }],
  });
  const wait = async (wanted) => {
    for (let tries = 0; tries < 100; tries += 1) {
      const found = events.find(wanted);
      if (found) return found;
      await new Promise((resolve) => setTimeout(resolve, 100));
    }
    return null;
  };
  const alarm = await wait((each) => each[3] === true && each[4] === true);
  if (alarm) {
    said.alarm = { message: alarm[1].text, severity: alarm[2], acknowledged: alarm[5] };
    const acknowledged = await session.call({
      objectId: alarm[6], methodId: resolveNodeId("AcknowledgeableConditionType_Acknowledge"),
      inputArguments: [
        { dataType: DataType.ByteString, value: alarm[0] },
        { dataType: DataType.LocalizedText, value: { text: "seen by the plant" } },
      ],
    });
    said.acknowledge = acknowledged.statusCode.name;
    said.cleared = Boolean(await wait((each) => each[3] === false && each[5] === true));
  }
  await subscription.terminate();
  await session.close();
  await client.disconnect();
  return said;
}

main().then(
  (said) => { console.log(JSON.stringify(said)); process.exit(0); },
  (error) => { console.error(error); process.exit(1); });
