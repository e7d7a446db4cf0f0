#include "server/page/uploads.h"

#include <grpcpp/client_context.h>

#include <cstdint>
#include <nlohmann/json.hpp>

#include "absl/strings/numbers.h"
#include "lumifold/v1/farm.grpc.pb.h"
#include "proto/rpc/checksum.h"
#include "proto/rpc/monotonic.h"
#include "proto/rpc/status_codec.h"
#include "server/page/farm_calls.h"

namespace lumifold::page {
namespace {

constexpr absl::Duration kPartTime = absl::Seconds(60);

http::Response Received(uint64_t bytes, bool is_complete) {
  const nlohmann::ordered_json json = {{"received_bytes", bytes}, {"complete", is_complete}};
  return {.content_type = "application/json", .body = json.dump()};
}

/// Sends one part. kDataLoss: more are missing, or the content is another one.
absl::Status SendPart(const FarmCalls& calls, const v1::PageSession& session, const v1::AssetRef& asset,
                      const v1::ByteChunk& part) {
  grpc::ClientContext context;
  context.set_deadline(rpc::MonotonicDeadline(kPartTime));
  FarmCalls::NameCaller(session, &context);
  const auto stub = v1::FarmService::NewStub(calls.channel());
  v1::UploadAssetResponse response;
  const auto writer = stub->UploadAsset(&context, &response);
  v1::UploadAssetRequest message;
  *message.mutable_announce() = asset;
  if (writer->Write(message)) {
    *message.mutable_chunk() = part;
    if (writer->Write(message)) writer->WritesDone();
  }
  return rpc::StatusFromGrpc(writer->Finish());
}

}  // namespace

absl::StatusOr<http::Response> AnswerUpload(const FarmCalls& calls, const v1::PageSession& session,
                                            const http::Request& request) {
  if (!session.job_id().empty()) return absl::PermissionDeniedError("this link changes nothing");
  v1::AssetRef asset;
  v1::ByteChunk part;
  uint64_t size = 0;
  uint64_t offset = 0;
  const bool is_right = absl::SimpleAtoi(request.Parameter("size").value_or(""), &size) &&
                        absl::SimpleAtoi(request.Parameter("offset").value_or("0"), &offset);
  if (!is_right) return absl::InvalidArgumentError("size and offset are whole numbers");
  asset.set_sha256(request.Parameter("sha256").value_or(""));
  asset.set_size(size);
  part.set_offset(offset);
  part.set_data(request.body);
  part.set_checksum(rpc::Checksum(request.body));
  part.set_total_size(size);
  const absl::Status sent = SendPart(calls, session, asset, part);
  if (sent.ok()) return Received(size, true);
  const bool is_last = offset + request.body.size() >= size;
  if (!absl::IsDataLoss(sent) || is_last) return sent;
  v1::FindUploadRequest question;
  *question.mutable_asset() = asset;
  v1::FindUploadResponse found;
  if (absl::Status status = calls.Call(session, "FindUpload", question, &found); !status.ok()) return status;
  if (found.received_bytes() <= offset && !request.body.empty()) return sent;
  return Received(found.received_bytes(), false);
}

}  // namespace lumifold::page
