#include "server/page/farm_calls.h"

#include <google/protobuf/descriptor.h>
#include <google/protobuf/util/json_util.h>
#include <grpcpp/generic/generic_stub.h>

#include <map>
#include <string_view>

#include "absl/strings/str_cat.h"
#include "absl/synchronization/notification.h"
#include "lumifold/v1/farm.grpc.pb.h"
#include "proto/rpc/message_json.h"
#include "proto/rpc/monotonic.h"
#include "proto/rpc/status_codec.h"
#include "server/access/caller_check.h"

namespace lumifold::page {
namespace {

using google::protobuf::Message;

constexpr absl::Duration kCallTime = absl::Seconds(30);

/// The calls that the page makes, and whether they are about one job and change nothing: those a session for
/// one job may make.
const std::map<std::string_view, bool>& PageCalls() {
  static const auto& calls = *new std::map<std::string_view, bool>{
      {"AddSamples", false}, {"BlockWorker", false}, {"CancelJob", false},      {"CreatePageLink", false},
      {"DeleteJob", false},  {"DrainWorker", false}, {"ExplainJob", true},      {"FindMissingAssets", false},
      {"FindUpload", false}, {"GetJob", true},       {"GetLog", true},          {"GetServerStatus", false},
      {"ListJobs", false},   {"ListWorkers", false}, {"PauseJob", false},       {"ReadmitWorker", false},
      {"ResumeJob", false},  {"RetryJob", false},    {"SetJobPriority", false}, {"SubmitJob", false},
  };
  return calls;
}

absl::Status CheckSession(const v1::PageSession& session, bool is_of_job, const Message& request) {
  if (session.job_id().empty()) return absl::OkStatus();
  const auto* field = request.GetDescriptor()->FindFieldByName("job_id");
  if (is_of_job && field != nullptr && request.GetReflection()->GetString(request, field) == session.job_id())
    return absl::OkStatus();
  return absl::PermissionDeniedError(
      absl::StrCat("this link shows job ", session.job_id(), " only, and changes nothing"));
}

}  // namespace

absl::StatusOr<std::string> FarmCalls::CallInJson(const v1::PageSession& session, const std::string& method,
                                                  const std::string& request) const {
  const auto call = PageCalls().find(method);
  if (call == PageCalls().end()) return absl::NotFoundError(absl::StrCat("the page makes no call ", method));
  const auto* service = google::protobuf::DescriptorPool::generated_pool()->FindServiceByName(
      v1::FarmService::service_full_name());
  const auto* descriptor = service->FindMethodByName(method);
  auto* factory = google::protobuf::MessageFactory::generated_factory();
  const std::unique_ptr<Message> sent(factory->GetPrototype(descriptor->input_type())->New());
  const std::unique_ptr<Message> answer(factory->GetPrototype(descriptor->output_type())->New());
  const auto parsed = google::protobuf::util::JsonStringToMessage(request, sent.get());
  if (!parsed.ok())
    return absl::InvalidArgumentError(absl::StrCat(method, ": ", std::string(parsed.message())));
  if (absl::Status status = CheckSession(session, call->second, *sent); !status.ok()) return status;
  if (absl::Status status = Call(session, method, *sent, answer.get()); !status.ok()) return status;
  return rpc::JsonOf(*answer);
}

void FarmCalls::NameCaller(const v1::PageSession& session, grpc::ClientContext* context) {
  if (!session.credential().empty()) context->AddMetadata(access::kInNameOfKey, session.credential());
}

absl::Status FarmCalls::Call(const v1::PageSession& session, const std::string& method,
                             const Message& request, Message* response) const {
  grpc::ClientContext context;
  context.set_deadline(rpc::MonotonicDeadline(kCallTime));
  NameCaller(session, &context);
  grpc::TemplatedGenericStub<Message, Message> stub(channel_);
  absl::Notification done;
  absl::Status result;
  stub.UnaryCall(&context, absl::StrCat("/", v1::FarmService::service_full_name(), "/", method), {}, &request,
                 response, [&](const grpc::Status& status) {
                   result = rpc::StatusFromGrpc(status);
                   done.Notify();
                 });
  done.WaitForNotification();
  return result;
}

}  // namespace lumifold::page
