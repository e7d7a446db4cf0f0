#include "server/coordinator/cleanup.h"

#include <spdlog/logger.h>

#include "proto/logging/fields.h"

namespace lumifold::server {
namespace {

/// Rows of units that are deleted in one transaction: a few milliseconds in which others cannot write.
constexpr int64_t kPurgedRows = 1000;

JanitorOptions JanitorOptionsOf(const Resources& resources) {
  JanitorOptions janitor{.limits = resources.options.retention,
                         .now = resources.options.now,
                         .wall_now = resources.options.wall_now,
                         .disk = [root = resources.folder.root()] { return DiskSpaceOf(root); },
                         .log = resources.options.log};
  janitor.limits.free_bytes = janitor.disk().kept_bytes;
  return janitor;
}

}  // namespace

Cleanup::Cleanup(const Resources* resources)
    : resources_(resources),
      janitor_(JanitorOptionsOf(*resources), resources->folder, resources->store, resources->assets, &purger_,
               &deleter_) {}

void Cleanup::DeleteFiles(const std::string& path) {
  deleter_.Run([this, path] {
    const absl::Status removed = RemoveAll(path, resources_->folder.files());
    if (!removed.ok()) {  // it only takes space until the next start
      resources_->log().warn("event=not_deleted error={}", logging::Quoted(removed.message()));
    }
  });
}

void Cleanup::PurgeUnits() {
  if (purging_.exchange(true)) return;
  purger_.Run([this] {
    purging_ = false;
    const absl::StatusOr<int64_t> left = resources_->store->PurgeUnits(kPurgedRows);
    // Rows that stay only take space until the next job ends.
    if (left.ok() && *left > 0) PurgeUnits();
  });
}

void Cleanup::Stop() {
  deleter_.Stop();
  purger_.Stop();
}

}  // namespace lumifold::server
