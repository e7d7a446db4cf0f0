#include "client/autoscale/slurm_queue.h"

#include <algorithm>
#include <map>
#include <optional>

#include "absl/strings/ascii.h"
#include "absl/strings/escaping.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "absl/strings/strip.h"

namespace lumifold::autoscale {
namespace {

enum Field { kId, kState, kStarted, kEnd, kCores, kReason, kName, kFields };
constexpr int64_t kMaxSlot = 1'000'000;
constexpr size_t kShownLineBytes = 120;

struct StateMeaning {
  Request::State state;
  Request::End end = Request::End::kNone;
};

StateMeaning MeaningOf(absl::string_view name) {
  using State = Request::State;
  using End = Request::End;
  static const auto* const meanings =
      new std::map<absl::string_view, StateMeaning>{{"RUNNING", {State::kRunning}},
                                                    {"SUSPENDED", {State::kRunning}},
                                                    {"STOPPED", {State::kRunning}},
                                                    {"COMPLETING", {State::kLeaving}},
                                                    {"COMPLETED", {State::kEnded, End::kLeft}},
                                                    {"FAILED", {State::kEnded, End::kFailed}},
                                                    {"BOOT_FAIL", {State::kEnded, End::kFailed}},
                                                    {"OUT_OF_MEMORY", {State::kEnded, End::kFailed}},
                                                    {"NODE_FAIL", {State::kEnded, End::kTaken}},
                                                    {"PREEMPTED", {State::kEnded, End::kTaken}},
                                                    {"REVOKED", {State::kEnded, End::kTaken}},
                                                    {"CANCELLED", {State::kEnded, End::kReleased}},
                                                    {"TIMEOUT", {State::kEnded, End::kReleased}},
                                                    {"DEADLINE", {State::kEnded, End::kReleased}}};
  const auto found = meanings->find(name);
  return found == meanings->end() ? StateMeaning{State::kPending} : found->second;
}

/// Infinite for a time that squeue does not know ("N/A"); nullopt for what is no time.
std::optional<absl::Time> ReadTime(absl::string_view text) {
  if (text == "N/A" || text == "Unknown" || text == "NONE") return absl::InfiniteFuture();
  absl::Time time;
  if (absl::StartsWith(text, "inf") ||
      !absl::ParseTime("%Y-%m-%dT%H:%M:%S", text, absl::UTCTimeZone(), &time, nullptr))
    return std::nullopt;
  return time;
}

std::optional<int> SlotOf(absl::string_view name, absl::string_view farm) {
  int64_t slot = -1;
  if (!absl::ConsumePrefix(&name, "lumifold-") || !absl::ConsumePrefix(&name, farm) ||
      !absl::ConsumePrefix(&name, "-") || name.empty() ||
      !std::all_of(name.begin(), name.end(), [](unsigned char c) { return absl::ascii_isdigit(c); }) ||
      !absl::SimpleAtoi(name, &slot) || slot > kMaxSlot)
    return std::nullopt;
  return static_cast<int>(slot);
}

bool IsJobId(absl::string_view text) {
  int64_t number = 0;
  return absl::SimpleAtoi(text, &number) && number > 0 && absl::StrCat(number) == text;
}

std::optional<Request> ReadFields(const std::vector<absl::string_view>& fields, int slot) {
  const std::optional<absl::Time> started = ReadTime(fields[kStarted]);
  const std::optional<absl::Time> end = ReadTime(fields[kEnd]);
  int cores = 0;
  if (!IsJobId(fields[kId]) || !started.has_value() || !end.has_value() ||
      !absl::SimpleAtoi(fields[kCores], &cores) || cores < 0)
    return std::nullopt;
  const StateMeaning meaning = MeaningOf(fields[kState]);
  Request request;
  request.id = std::string(fields[kId]);
  request.worker_name = absl::StrCat("slurm-", request.id);
  request.state = meaning.state;
  request.end = meaning.end;
  request.slot = slot;
  request.cores = cores;
  // Of a pending job it is the start that Slurm plans; of a running one the end is its time limit.
  if (meaning.state != Request::State::kPending) request.started = *started;
  if (meaning.state == Request::State::kEnded) {
    request.ended = *end;
    request.detail = absl::StrCat(fields[kState], ", ", fields[kReason]);
  } else if (fields[kReason] != "None") {
    request.detail = std::string(fields[kReason]);
  }
  return request;
}

void MarkDuplicates(std::vector<Request>* requests) {
  std::map<int, Request*> of_slot;
  const auto precedes = [](const Request& a, const Request& b) {
    const bool a_waits = a.state == Request::State::kPending;
    const bool b_waits = b.state == Request::State::kPending;
    if (a_waits != b_waits) return b_waits;
    return std::pair(a.id.size(), a.id) < std::pair(b.id.size(), b.id);  // by number
  };
  for (Request& request : *requests) {
    if (request.state == Request::State::kEnded) continue;
    Request*& first = of_slot[request.slot];
    if (first == nullptr) {
      first = &request;
    } else if (precedes(request, *first)) {
      first->duplicate = true;
      first = &request;
    } else {
      request.duplicate = true;
    }
  }
}

}  // namespace

std::string SlurmJobName(absl::string_view farm, int slot) {
  return absl::StrCat("lumifold-", farm, "-", slot);
}

absl::StatusOr<std::vector<Request>> ParseSlurmQueue(absl::string_view text, absl::string_view farm) {
  std::vector<Request> requests;
  for (const absl::string_view line : absl::StrSplit(text, '\n', absl::SkipEmpty())) {
    const std::vector<absl::string_view> fields = absl::StrSplit(line, absl::MaxSplits('|', kFields - 1));
    std::optional<Request> request;
    if (fields.size() == kFields) {
      const std::optional<int> slot = SlotOf(fields[kName], farm);
      if (!slot.has_value()) continue;
      request = ReadFields(fields, *slot);
    }
    if (!request.has_value())
      return absl::DataLossError(absl::StrCat("squeue printed a line that is not understood: ",
                                              absl::CHexEscape(line.substr(0, kShownLineBytes))));
    requests.push_back(*std::move(request));
  }
  MarkDuplicates(&requests);
  return requests;
}

}  // namespace lumifold::autoscale
