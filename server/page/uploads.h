#pragma once

#include "absl/status/statusor.h"
#include "lumifold/v1/farm.pb.h"
#include "proto/http/message.h"

namespace lumifold::page {

class FarmCalls;

/// Takes the next part of an asset: the request's body, from the byte `offset` on. The asset is named by its
/// SHA-256 and `size`. Answers how much the coordinator has, and whether that is all, so that the caller
/// knows where to go on also after an error.
/// Errors: those of FindUpload and UploadAsset.
absl::StatusOr<http::Response> AnswerUpload(const FarmCalls& calls, const v1::PageSession& session,
                                            const http::Request& request);

}  // namespace lumifold::page
