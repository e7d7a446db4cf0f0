#pragma once

#include <cstdint>
#include <string>

#include "absl/strings/string_view.h"
#include "absl/time/time.h"
#include "lumifold/v1/job.pb.h"

namespace lumifold::webhooks {

/// The v1::WebhookMessage of a job, as JSON.
std::string MessageOf(const v1::JobStatus& ended, const std::string& delivery_id, absl::Time end);

/// The value of X-Lumifold-Signature: "sha256=" and the HMAC-SHA256 of "TIMESTAMP.BODY" in hexadecimal.
std::string SignatureOf(absl::string_view secret, int64_t timestamp, absl::string_view body);

}  // namespace lumifold::webhooks
