#include "server/commit/unit_sender.h"

#include <algorithm>

#include "proto/rpc/checksum.h"
#include "proto/rpc/limits.h"

namespace lumifold::server {

absl::StatusOr<bool> UnitSender::Next(v1::ByteChunk* chunk) {
  while (pending_.size() < rpc::kMaxChunkBytes && next_unit_ < units_.places()) {
    const absl::StatusOr<std::string> record = units_.RecordBytes(next_unit_++);
    if (!record.ok()) return record.status();
    pending_.append(*record);
  }
  if (pending_.empty()) return false;
  const size_t size = std::min(pending_.size(), rpc::kMaxChunkBytes);
  chunk->Clear();
  chunk->set_offset(sent_);
  chunk->set_data(pending_.substr(0, size));
  chunk->set_checksum(rpc::Checksum(chunk->data()));
  chunk->set_total_size(size_);
  if (sent_ == 0) chunk->set_film_levels(film_levels_);
  pending_.erase(0, size);
  sent_ += size;
  return true;
}

}  // namespace lumifold::server
