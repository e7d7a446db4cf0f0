#pragma once

#include <string>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "lumifold/v1/farm.pb.h"
#include "proto/http/message.h"

namespace lumifold::page {

class FarmCalls;

/// The file of a frame, from the start or from the byte of a header Range on. `calls` must outlive the
/// answer. Errors: those of DownloadResult.
absl::StatusOr<http::Response> AnswerResult(const FarmCalls& calls, const v1::PageSession& session,
                                            const http::Request& request);

/// The files of all finished frames of a job as a ZIP archive. `calls` must outlive the answer.
/// Errors: those of GetJob; kFailedPrecondition while no frame is finished.
absl::StatusOr<http::Response> AnswerArchive(const FarmCalls& calls, const v1::PageSession& session,
                                             const http::Request& request);

/// A file's name that every system takes: of the display name of a job without its ending. `suffix`: what is
/// added to it.
std::string FileNameOf(absl::string_view display_name, absl::string_view suffix);

}  // namespace lumifold::page
