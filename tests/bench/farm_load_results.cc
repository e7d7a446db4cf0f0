#include "tests/bench/farm_load_results.h"

#include <grpcpp/grpcpp.h>

#include <algorithm>
#include <random>
#include <string_view>

#include "proto/rpc/checksum.h"
#include "proto/rpc/limits.h"
#include "proto/rpc/sha256.h"
#include "proto/rpc/status_codec.h"

namespace lumifold::bench {
namespace {

std::string RandomBytes(size_t count) {
  std::string bytes(count, '\0');
  std::minstd_rand random(1);
  for (char& byte : bytes) byte = static_cast<char>(random() >> 8);
  return bytes;
}

}  // namespace

ReadyResults::ReadyResults(size_t bytes) : file_(RandomBytes(bytes)), sha256_(rpc::Sha256Hex(file_)) {}

absl::Status ReadyResults::Finish(v1::WorkerService::StubInterface* coordinator, const std::string& worker_id,
                                  const v1::Lease& lease) const {
  if (lease.keep()) return Deliver(coordinator, worker_id, lease);
  begun_.WaitForNotification();
  v1::FetchUnitsRequest request;
  request.set_worker_id(worker_id);
  *request.mutable_unit() = lease.unit();
  request.set_attempt(lease.attempt());
  grpc::ClientContext context;
  const auto reader = coordinator->FetchUnits(&context, request);
  v1::ByteChunk chunk;
  while (reader->Read(&chunk)) {
  }
  if (absl::Status status = rpc::StatusFromGrpc(reader->Finish()); !status.ok()) return status;
  return Deliver(coordinator, worker_id, lease);
}

absl::Status ReadyResults::Deliver(v1::WorkerService::StubInterface* coordinator,
                                   const std::string& worker_id, const v1::Lease& lease) const {
  grpc::ClientContext context;
  v1::DeliverResultResponse response;
  const auto writer = coordinator->DeliverResult(&context, &response);
  v1::DeliverResultRequest request;
  request.mutable_announce()->set_worker_id(worker_id);
  *request.mutable_announce()->mutable_unit() = lease.unit();
  request.mutable_announce()->set_attempt(lease.attempt());
  bool is_open = writer->Write(request);
  for (size_t offset = 0; is_open && offset < file_.size(); offset += rpc::kMaxChunkBytes) {
    const std::string_view data = std::string_view(file_).substr(offset, rpc::kMaxChunkBytes);
    v1::ByteChunk* const chunk = request.mutable_chunk();
    chunk->Clear();
    chunk->set_offset(offset);
    chunk->set_data(data.data(), data.size());
    chunk->set_checksum(rpc::Checksum(data));
    chunk->set_total_size(file_.size());
    if (offset == 0) chunk->set_sha256(sha256_);
    is_open = writer->Write(request);
  }
  writer->WritesDone();
  return rpc::StatusFromGrpc(writer->Finish());
}

}  // namespace lumifold::bench
