#include "client/autoscale/kubernetes_objects.h"

#include <algorithm>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>

#include "absl/strings/escaping.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/strip.h"

namespace lumifold::autoscale {
namespace {

using Json = nlohmann::json;

constexpr size_t kShownBytes = 300;
constexpr double kMaxCores = 1e6;

/// What is at `path` ("metadata/name"), or null.
const Json& At(const Json& object, absl::string_view path) {
  static const Json* const none = new Json();
  const Json* found = &object;
  while (!path.empty() && found->is_object()) {
    const size_t slash = std::min(path.find('/'), path.size());
    const auto field = found->find(std::string(path.substr(0, slash)));
    found = field == found->end() ? none : &*field;
    path.remove_prefix(std::min(slash + 1, path.size()));
  }
  return path.empty() ? *found : *none;
}

std::string TextAt(const Json& object, absl::string_view path) {
  const Json& found = At(object, path);
  return found.is_string() ? found.get<std::string>() : "";
}

/// The elements of an array; none of anything else, which Json would iterate too.
const Json& ListAt(const Json& object, absl::string_view path) {
  static const Json* const empty = new Json(Json::array());
  const Json& found = At(object, path);
  return found.is_array() ? found : *empty;
}

absl::StatusOr<Json> ParseObject(absl::string_view text, const char* what) {
  Json json = Json::parse(text.begin(), text.end(), nullptr, /*allow_exceptions=*/false);
  if (json.is_object()) return json;
  return absl::DataLossError(absl::StrCat("the answer of the Kubernetes API is no ", what));
}

absl::Time TimeAt(const Json& object, absl::string_view path) {
  absl::Time time;
  const std::string text = TextAt(object, path);
  return absl::ParseTime(absl::RFC3339_full, text, &time, nullptr) ? time : absl::InfiniteFuture();
}

/// A quantity of processors: "2", "1.5", "500m".
std::optional<double> Cores(absl::string_view text) {
  const bool thousandths = absl::ConsumeSuffix(&text, "m");
  double number = 0;
  if (!absl::SimpleAtod(text, &number) || !(number >= 0 && number <= kMaxCores)) return std::nullopt;
  return thousandths ? number / 1000 : number;
}

double CoresOf(const Json& pod, double default_cores) {
  double sum = 0;
  for (const Json& container : ListAt(pod, "spec/containers")) {
    for (const char* path : {"resources/requests/cpu", "resources/limits/cpu"}) {
      if (const std::optional<double> cores = Cores(TextAt(container, path)); cores.has_value()) {
        sum += *cores;
        break;
      }
    }
  }
  return sum > 0 ? sum : default_cores;
}

bool WasTaken(const Json& pod) {
  const std::string reason = TextAt(pod, "status/reason");
  if (reason == "Evicted" || reason == "Preempting" || reason == "NodeLost" || reason == "Shutdown" ||
      reason == "NodeShutdown" || reason == "Terminated")
    return true;
  const Json& conditions = ListAt(pod, "status/conditions");
  return std::any_of(conditions.begin(), conditions.end(), [](const Json& condition) {
    return TextAt(condition, "type") == "DisruptionTarget" && TextAt(condition, "status") == "True";
  });
}

/// Why a pod does not run: its container's reason to wait, or the scheduler's.
std::string WhyWaiting(const Json& pod) {
  for (const Json& container : ListAt(pod, "status/containerStatuses")) {
    const std::string reason = TextAt(container, "state/waiting/reason");
    if (!reason.empty() && reason != "ContainerCreating") return reason;
  }
  for (const Json& condition : ListAt(pod, "status/conditions")) {
    if (TextAt(condition, "type") == "PodScheduled" && TextAt(condition, "status") == "False")
      return TextAt(condition, "message");
  }
  return "";
}

void SetState(const Json& pod, Request* request) {
  const std::string phase = TextAt(pod, "status/phase");
  if (phase == "Succeeded" || phase == "Failed") {
    request->state = Request::State::kEnded;
    request->end = phase == "Succeeded" ? Request::End::kLeft : Request::End::kFailed;
    if (WasTaken(pod)) request->end = Request::End::kTaken;
    for (const Json& container : ListAt(pod, "status/containerStatuses"))
      request->ended = std::min(request->ended, TimeAt(container, "state/terminated/finishedAt"));
    request->detail = TextAt(pod, "status/reason");
    return;
  }
  const bool leaving = At(pod, "metadata/deletionTimestamp").is_string();
  request->detail = WhyWaiting(pod);
  // One that crashes again and again is Running, and its container waits.
  const bool runs = phase == "Running" && request->detail.empty();
  const Request::State state = runs ? Request::State::kRunning : Request::State::kPending;
  request->state = leaving ? Request::State::kLeaving : state;
}

}  // namespace

absl::StatusOr<Scale> ParseScale(absl::string_view json) {
  const absl::StatusOr<Json> object = ParseObject(json, "Scale");
  if (!object.ok()) return object.status();
  Scale scale;
  if (const Json& replicas = At(*object, "spec/replicas"); replicas.is_number_integer()) {
    const auto number = replicas.get<int64_t>();
    if (number < 0 || number > std::numeric_limits<int>::max())
      return absl::DataLossError(absl::StrCat("the Deployment has ", number, " replicas"));
    scale.replicas = static_cast<int>(number);
  }
  scale.selector = TextAt(*object, "status/selector");
  scale.version = TextAt(*object, "metadata/resourceVersion");
  if (scale.selector.empty() || scale.version.empty())
    return absl::DataLossError("the scale of the Deployment has no selector or no version");
  return scale;
}

absl::StatusOr<std::string> ParseReplicaFailure(absl::string_view json) {
  const absl::StatusOr<Json> object = ParseObject(json, "Deployment");
  if (!object.ok()) return object.status();
  for (const Json& condition : ListAt(*object, "status/conditions")) {
    if (TextAt(condition, "type") == "ReplicaFailure" && TextAt(condition, "status") == "True")
      return TextAt(condition, "message");
  }
  return "";
}

absl::StatusOr<PodPage> ParsePods(absl::string_view json, double default_cores) {
  const absl::StatusOr<Json> object = ParseObject(json, "PodList");
  if (!object.ok()) return object.status();
  PodPage page;
  page.next = TextAt(*object, "metadata/continue");
  for (const Json& pod : ListAt(*object, "items")) {
    Request request;
    request.id = TextAt(pod, "metadata/name");
    if (request.id.empty()) return absl::DataLossError("the Kubernetes API lists a pod without a name");
    request.worker_name = request.id;
    request.started = TimeAt(pod, "status/startTime");
    request.cores = CoresOf(pod, default_cores);
    SetState(pod, &request);
    // The name of an annotation has slashes.
    const Json& annotations = At(pod, "metadata/annotations");
    const auto cost = annotations.is_object() ? annotations.find(kDeletionCost) : annotations.end();
    if (cost != annotations.end() && cost->is_string() && cost->get<std::string>().starts_with('-'))
      page.marked.push_back(request.id);
    page.pods.push_back(std::move(request));
  }
  return page;
}

std::string MessageOf(absl::string_view json) {
  const Json object = Json::parse(json.begin(), json.end(), nullptr, /*allow_exceptions=*/false);
  std::string message = TextAt(object, "message");
  return absl::Utf8SafeCHexEscape(
      (message.empty() ? json : absl::string_view(message)).substr(0, kShownBytes));
}

}  // namespace lumifold::autoscale
