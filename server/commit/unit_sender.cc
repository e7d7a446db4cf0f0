#include "server/commit/unit_sender.h"

#include <algorithm>

#include "proto/rpc/checksum.h"
#include "proto/rpc/limits.h"

namespace lumifold::server {

absl::Status UnitSender::Read(absl::Span<char> bytes) {
  while (!bytes.empty()) {
    const bool is_unit = unit_ < units_.places();
    const uint64_t left = (is_unit ? units_.record_bytes(unit_) : rounds_.size()) - of_record_;
    if (left == 0) {
      ++unit_;
      of_record_ = 0;
      continue;
    }
    const size_t count = std::min<uint64_t>(left, bytes.size());
    const absl::Status status =
        is_unit ? units_.ReadRecord(unit_, of_record_, bytes.first(count)) : absl::OkStatus();
    if (!status.ok()) return status;
    if (!is_unit) rounds_.copy(bytes.data(), count, of_record_);
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
  if (sent_ == 0) {
    chunk->set_film_levels(film_levels_);
    chunk->set_rounds_bytes(rounds_.size());
  }
  sent_ += data.size();
  return true;
}

}  // namespace lumifold::server
