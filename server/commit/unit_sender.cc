#include "server/commit/unit_sender.h"

#include <algorithm>

#include "proto/rpc/checksum.h"
#include "proto/rpc/limits.h"

namespace lumifold::server {

absl::Status UnitSender::Read(absl::Span<char> bytes) {
  while (!bytes.empty()) {
    const uint64_t left = units_.record_bytes(unit_) - of_record_;
    if (left == 0) {
      ++unit_;
      of_record_ = 0;
      continue;
    }
    const size_t count = std::min<uint64_t>(left, bytes.size());
    if (absl::Status status = units_.ReadRecord(unit_, of_record_, bytes.first(count)); !status.ok())
      return status;
    of_record_ += count;
    bytes.remove_prefix(count);
  }
  return absl::OkStatus();
}

absl::StatusOr<bool> UnitSender::Next(v1::ByteChunk* chunk) {
  if (sent_ == size_) return false;
  chunk->Clear();
  std::string& data = *chunk->mutable_data();
  data.resize(std::min<uint64_t>(rpc::kMaxChunkBytes, size_ - sent_));
  if (absl::Status status = Read(absl::MakeSpan(data)); !status.ok()) return status;
  chunk->set_offset(sent_);
  chunk->set_checksum(rpc::Checksum(data));
  chunk->set_total_size(size_);
  if (sent_ == 0) chunk->set_film_levels(film_levels_);
  sent_ += data.size();
  return true;
}

}  // namespace lumifold::server
