#include "client/autoscale/kubernetes_engine.h"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <set>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "client/autoscale/http_call.h"
#include "client/autoscale/kubernetes_objects.h"
#include "filter/image/file_io.h"

namespace lumifold::autoscale {
namespace {

using Json = nlohmann::json;

constexpr int kPageItems = 500;
constexpr int64_t kMaxTokenBytes = 1 << 16;
constexpr char kMergePatch[] = "application/merge-patch+json";
constexpr char kLowCost[] = "-1000";
constexpr char kUsualCost[] = "0";

absl::Status StatusOf(const HttpAnswer& answer, const std::string& path) {
  if (answer.code >= 200 && answer.code < 300) return absl::OkStatus();
  const std::string text =
      absl::StrCat("the Kubernetes API answers ", answer.code, " to ", path, ": ", MessageOf(answer.body));
  switch (answer.code) {
    case 401:
    case 403:
      return absl::PermissionDeniedError(text);
    case 409:
      return absl::AbortedError(text);
    case 429:
      return absl::UnavailableError(text);
    default:
      return answer.code >= 500 ? absl::UnavailableError(text) : absl::InternalError(text);
  }
}

class KubernetesEngine final : public Engine {
 public:
  explicit KubernetesEngine(KubernetesOptions options) : options_(std::move(options)) {}

  absl::StatusOr<EngineState> Look() override {
    const absl::StatusOr<std::string> scale_json = Call("GET", ScalePath(), "");
    if (!scale_json.ok()) return scale_json.status();
    absl::StatusOr<Scale> scale = ParseScale(*scale_json);
    if (!scale.ok()) return scale.status();
    const absl::StatusOr<std::string> deployment = Call("GET", DeploymentPath(), "");
    if (!deployment.ok()) return deployment.status();
    const absl::StatusOr<std::string> failure = ParseReplicaFailure(*deployment);
    if (!failure.ok()) return failure.status();
    EngineState state;
    state.refusal = *failure;
    state.version = scale->version;
    if (absl::Status status = AddPods(scale->selector, &state); !status.ok()) return status;
    AddMissingPods(scale->replicas, &state);
    replicas_ = scale->replicas;
    return state;
  }

  absl::Status Start(const EngineState& seen, int count) override {
    return SetReplicas(replicas_ + count, seen.version);
  }

  absl::Status Release(const EngineState& seen, const std::vector<std::string>& ids) override {
    const std::set<std::string> chosen(ids.begin(), ids.end());
    for (const Request& request : seen.requests) {
      if (request.state != Request::State::kPending && request.state != Request::State::kRunning) continue;
      const bool is_chosen = chosen.contains(request.id) && !request.worker_name.empty();
      if (is_chosen == marked_.contains(request.id)) continue;
      const absl::Status status = SetCost(request.id, is_chosen ? kLowCost : kUsualCost);
      if (!status.ok() && !absl::IsNotFound(status)) return status;
    }
    return SetReplicas(std::max(0, replicas_ - static_cast<int>(ids.size())), seen.version);
  }

 private:
  std::string DeploymentPath() const {
    return absl::StrCat("/apis/apps/v1/namespaces/", options_.name_space, "/deployments/",
                        options_.deployment);
  }
  std::string ScalePath() const { return DeploymentPath() + "/scale"; }
  std::string PodsPath() const { return absl::StrCat("/api/v1/namespaces/", options_.name_space, "/pods"); }

  absl::Status AddPods(const std::string& selector, EngineState* state) {
    marked_.clear();
    std::string next;
    do {
      std::string path =
          absl::StrCat(PodsPath(), "?limit=", kPageItems, "&labelSelector=", UrlEscape(selector));
      if (!next.empty()) absl::StrAppend(&path, "&continue=", UrlEscape(next));
      const absl::StatusOr<std::string> json = Call("GET", path, "");
      if (!json.ok()) return json.status();
      absl::StatusOr<PodPage> page = ParsePods(*json, options_.cores_per_worker);
      if (!page.ok()) return page.status();
      std::move(page->pods.begin(), page->pods.end(), std::back_inserter(state->requests));
      marked_.insert(page->marked.begin(), page->marked.end());
      next = page->next;
    } while (!next.empty());
    for (const Request& request : state->requests) {
      if (request.detail == "CrashLoopBackOff" && state->refusal.empty())
        state->refusal = absl::StrCat("pod ", request.id, " crashes at its start again and again");
    }
    return absl::OkStatus();
  }

  static void AddMissingPods(int replicas, EngineState* state) {
    const auto is_replica = [](const Request& request) {
      return request.state == Request::State::kPending || request.state == Request::State::kRunning;
    };
    const auto pods = std::count_if(state->requests.begin(), state->requests.end(), is_replica);
    for (auto i = pods; i < replicas; ++i) {
      Request missing;
      missing.id = absl::StrCat("replica ", i, " without a pod");  // no pod can be called so
      state->requests.push_back(std::move(missing));
    }
  }

  absl::Status SetReplicas(int replicas, const std::string& version) const {
    const Json patch = {{"metadata", {{"resourceVersion", version}}}, {"spec", {{"replicas", replicas}}}};
    return Call("PATCH", ScalePath(), patch.dump()).status();
  }

  absl::Status SetCost(const std::string& pod, const char* cost) const {
    const Json patch = {{"metadata", {{"annotations", {{kDeletionCost, cost}}}}}};
    return Call("PATCH", absl::StrCat(PodsPath(), "/", pod), patch.dump()).status();
  }

  /// The body of an answer that is no error.
  absl::StatusOr<std::string> Call(const std::string& method, const std::string& path,
                                   const std::string& body) const {
    HttpRequest request{.method = method,
                        .url = options_.api + path,
                        .headers = {"Accept: application/json"},
                        .body = body,
                        .ca_file = options_.ca_file,
                        .timeout = options_.timeout};
    if (!body.empty()) request.headers.push_back(absl::StrCat("Content-Type: ", kMergePatch));
    if (!options_.token_file.empty()) {
      const absl::StatusOr<std::string> token = ReadFile(options_.token_file, kMaxTokenBytes);
      if (!token.ok()) return token.status();
      request.headers.push_back(absl::StrCat("Authorization: Bearer ", absl::StripAsciiWhitespace(*token)));
    }
    absl::StatusOr<HttpAnswer> answer = CallHttp(request);
    if (!answer.ok()) return answer.status();
    if (absl::Status status = StatusOf(*answer, path); !status.ok()) return status;
    return std::move(answer->body);
  }

  const KubernetesOptions options_;
  int replicas_ = 0;              // at the last look
  std::set<std::string> marked_;  // pods with a low deletion cost, at the last look
};

}  // namespace

std::unique_ptr<Engine> MakeKubernetesEngine(KubernetesOptions options) {
  return std::make_unique<KubernetesEngine>(std::move(options));
}

}  // namespace lumifold::autoscale
