#pragma once

#include <string>

#include "absl/status/status.h"
#include "absl/types/span.h"
#include "filter/image/file_system.h"
#include "server/film/unit_log.h"

namespace lumifold::film {

/// Takes records out of a unit log for ever, because their units are to be rendered again: overwrites the
/// first bytes of each, so that a scan passes over it. The other records keep their places. Returns once that
/// is on the disk; after a crash or an error some of the records are void.
/// Errors: kNotFound where there is no log; kUnavailable with the system's message.
absl::Status VoidRecords(const std::string& path, absl::Span<const RecordPlace> places,
                         FileSystem* files = PrivateFileSystem());

}  // namespace lumifold::film
