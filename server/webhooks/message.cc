#include "server/webhooks/message.h"

#include "absl/strings/str_cat.h"
#include "proto/rpc/message_json.h"
#include "server/access/mac.h"

namespace lumifold::webhooks {

std::string MessageOf(const v1::JobStatus& ended, const std::string& delivery_id, absl::Time end) {
  v1::WebhookMessage message;
  message.set_delivery_id(delivery_id);
  message.set_job_id(ended.job_id());
  message.set_name(ended.display_name());
  message.set_user(ended.scheduling().user());
  message.set_state(ended.state());
  message.set_error(ended.error());
  message.set_submitted_unix_ms(ended.submitted_unix_ms());
  message.set_ended_unix_ms(absl::ToUnixMillis(end));
  *message.mutable_times() = ended.times();
  message.set_frames_done(ended.frames_done());
  message.set_frames_total(ended.frames_total());
  message.set_frames_skipped(ended.frames_skipped());
  auto& links = *message.mutable_links();
  if (ended.frames_done() > 0) links["results"] = absl::StrCat("/api/results?job=", ended.job_id());
  if (ended.state() == v1::JOB_STATE_DONE)
    links["result"] = absl::StrCat("/api/result?job=", ended.job_id(), "&frame=", ended.first_frame());
  return rpc::JsonOf(message);
}

std::string SignatureOf(absl::string_view secret, int64_t timestamp, absl::string_view body) {
  return absl::StrCat("sha256=", access::MacOf(secret, absl::StrCat(timestamp, ".", body)));
}

}  // namespace lumifold::webhooks
