#include "server/page/result_stream.h"

#include <grpcpp/client_context.h>

#include <utility>

#include "lumifold/v1/farm.grpc.pb.h"
#include "proto/rpc/status_codec.h"
#include "server/page/farm_calls.h"

namespace lumifold::page {
namespace {

class ResultStreamImpl final : public ResultStream {
 public:
  ResultStreamImpl(const FarmCalls& calls, const v1::PageSession& session,
                   const v1::DownloadResultRequest& request)
      : stub_(v1::FarmService::NewStub(calls.channel())) {
    FarmCalls::NameCaller(session, &context_);
    reader_ = stub_->DownloadResult(&context_, request);
  }
  ~ResultStreamImpl() override {
    if (has_ended_) return;
    context_.TryCancel();
    (void)reader_->Finish();
  }

  absl::Status ReadFirst() {
    if (!reader_->Read(&chunk_)) return End();
    size_ = chunk_.total_size();
    sha256_ = chunk_.sha256();
    has_first_ = true;
    return absl::OkStatus();
  }

  absl::StatusOr<std::optional<std::string>> Next() override {
    if (has_ended_) return std::nullopt;
    if (!std::exchange(has_first_, false) && !reader_->Read(&chunk_)) {
      if (absl::Status status = End(); !status.ok()) return status;
      return std::nullopt;
    }
    return std::move(*chunk_.mutable_data());
  }
  uint64_t size() const override { return size_; }
  const std::string& sha256() const override { return sha256_; }

 private:
  absl::Status End() {
    has_ended_ = true;
    return rpc::StatusFromGrpc(reader_->Finish());
  }

  grpc::ClientContext context_;
  const std::unique_ptr<v1::FarmService::Stub> stub_;
  std::unique_ptr<grpc::ClientReader<v1::ByteChunk>> reader_;
  v1::ByteChunk chunk_;
  bool has_first_ = false;  // chunk_ has not been returned
  bool has_ended_ = false;
  uint64_t size_ = 0;
  std::string sha256_;
};

}  // namespace

absl::StatusOr<std::unique_ptr<ResultStream>> ResultStream::Open(const FarmCalls& calls,
                                                                 const v1::PageSession& session,
                                                                 const v1::DownloadResultRequest& request) {
  auto stream = std::make_unique<ResultStreamImpl>(calls, session, request);
  if (absl::Status status = stream->ReadFirst(); !status.ok()) return status;
  return stream;
}

}  // namespace lumifold::page
