// Follows a job of a farm from Node, over TLS. The messages come from the coordinator itself, by gRPC's server reflection.
//
//     node watch.mjs JOB [PROFILE]
//
// PROFILE is one of `lumifold login` (default: "default"). Needs the packages @grpc/grpc-js, @grpc/proto-loader and protobufjs.

import fs from "node:fs";
import os from "node:os";
import path from "node:path";
import grpc from "@grpc/grpc-js";
import loader from "@grpc/proto-loader";
import protobuf from "protobufjs";

const OPTIONS = {keepCase: true, longs: String, enums: String, defaults: true};
const SERVICE = "lumifold.v1.FarmService";

// The part of grpc/reflection/v1alpha/reflection.proto that is needed to ask for a service.
const REFLECTION = protobuf.parse(`
  syntax = "proto3";
  package grpc.reflection.v1alpha;
  message ServerReflectionRequest { oneof message_request { string file_containing_symbol = 4; } }
  message ServerReflectionResponse { FileDescriptorResponse file_descriptor_response = 4; ErrorResponse error_response = 7; }
  message FileDescriptorResponse { repeated bytes file_descriptor_proto = 1; }
  message ErrorResponse { int32 error_code = 1; string error_message = 2; }
`).root;

function connection(profile) {
  const config = process.env.XDG_CONFIG_HOME ?? path.join(os.homedir(), ".config");
  const read = (name) => fs.readFileSync(path.join(config, "lumifold", profile, name));
  const settings = Object.fromEntries(read("profile").toString().split("\n").filter((line) => line.includes("=")).map((line) => line.split("=", 2)));
  const token = read("token").toString().trim();
  const withToken = grpc.credentials.createFromMetadataGenerator((_, done) => {
    const metadata = new grpc.Metadata();
    metadata.set("authorization", `Bearer ${token}`);
    done(null, metadata);
  });
  const credentials = grpc.credentials.combineChannelCredentials(grpc.credentials.createSsl(read("ca.pem")), withToken);
  return [settings.server.split(",")[0], credentials];
}

/** A FileDescriptorSet of the file that has `symbol`, and of those that it imports. */
function describe(address, credentials, symbol) {
  const types = "grpc.reflection.v1alpha.ServerReflection";
  const request = REFLECTION.lookupType(`${types}Request`);
  const response = REFLECTION.lookupType(`${types}Response`);
  const client = new grpc.Client(address, credentials);
  return new Promise((resolve, reject) => {
    const call = client.makeBidiStreamRequest(`/${types}/ServerReflectionInfo`,
      (message) => Buffer.from(request.encode(message).finish()), (bytes) => response.decode(bytes));
    call.on("error", reject);
    call.on("data", (answer) => {
      call.end();
      if (answer.error_response) return reject(new Error(answer.error_response.error_message));
      const writer = protobuf.Writer.create();
      for (const file of answer.fileDescriptorResponse.fileDescriptorProto) writer.uint32(10).bytes(file);
      resolve(Buffer.from(writer.finish()));
    });
    call.write({fileContainingSymbol: symbol});
  });
}

const [job, profile = "default"] = process.argv.slice(2);
if (!job) throw new Error("usage: node watch.mjs JOB [PROFILE]");
const [address, credentials] = connection(profile);
const definition = loader.loadFileDescriptorSetFromBuffer(await describe(address, credentials, SERVICE), OPTIONS);
const {FarmService} = grpc.loadPackageDefinition(definition).lumifold.v1;
const farm = new FarmService(address, credentials);
farm.WatchJob({job_id: job})
  .on("data", (status) => console.log(`${status.job_id} ${status.state} ${status.samples_done}/${status.samples_total}`))
  .on("error", (error) => { console.error(error.message); process.exitCode = 1; })
  .on("end", () => farm.close());
