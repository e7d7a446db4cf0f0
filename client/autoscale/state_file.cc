#include "client/autoscale/state_file.h"

#include <fcntl.h>
#include <sys/file.h>

#include <cerrno>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>

#include "absl/strings/str_cat.h"
#include "filter/image/file_calls.h"
#include "filter/image/file_system.h"
#include "proto/rpc/checked_file.h"

namespace lumifold::autoscale {
namespace {

using Json = nlohmann::json;

constexpr rpc::CheckedFileType kStateFile = {"LFA1", "the state of the autoscaler", int64_t{64} << 20};
constexpr mode_t kMode = 0644;

double SecondsOf(absl::Time time) { return absl::ToDoubleSeconds(time - absl::UnixEpoch()); }

/// null for a time that is not finite, which JSON does not have.
Json TimeJson(absl::Time time) { return time == absl::InfinitePast() ? Json() : Json(SecondsOf(time)); }

Json BackoffJson(const Backoff& backoff) {
  return {{"failures", backoff.failures}, {"last", TimeJson(backoff.last)}, {"why", backoff.why}};
}

/// Reads fields and remembers whether one was missing or of another type.
class Reader {
 public:
  bool ok() const { return ok_; }

  double Number(const Json& object, const char* name) {
    const Json* const field = Find(object, name);
    if (field != nullptr && field->is_number()) return field->get<double>();
    ok_ = false;
    return 0;
  }
  absl::Time Time(const Json& object, const char* name) {
    const Json* const field = Find(object, name);
    if (field != nullptr && field->is_null()) return absl::InfinitePast();
    return absl::UnixEpoch() + absl::Seconds(Number(object, name));
  }
  std::string Text(const Json& value) {
    if (value.is_string()) return value.get<std::string>();
    ok_ = false;
    return "";
  }
  const Json& Child(const Json& object, const char* name) {
    static const Json* const none = new Json();
    const Json* const field = Find(object, name);
    if (field == nullptr) ok_ = false;
    return field == nullptr ? *none : *field;
  }
  Backoff ReadBackoff(const Json& object) {
    const double failures = Number(object, "failures");
    ok_ = ok_ && failures >= 0 && failures <= 1e9;
    return {.failures = ok_ ? static_cast<int>(failures) : 0,
            .last = Time(object, "last"),
            .why = Text(Child(object, "why"))};
  }

 private:
  static const Json* Find(const Json& object, const char* name) {
    const auto field = object.find(name);
    return object.is_object() && field != object.end() ? &*field : nullptr;
  }
  bool ok_ = true;
};

}  // namespace

std::string HistoryJson(const History& history) {
  Json charges = Json::object();
  for (const auto& [life, charge] : history.charges)
    charges[life] = {
        {"cores", charge.cores}, {"from", SecondsOf(charge.from)}, {"until", SecondsOf(charge.until)}};
  const Json json = {{"refusals", BackoffJson(history.refusals)},
                     {"deaths", BackoffJson(history.deaths)},
                     {"counted_ends", history.counted_ends},
                     {"period_start", TimeJson(history.period_start)},
                     {"spent_core_seconds", history.spent_core_seconds},
                     {"charges", std::move(charges)},
                     {"seconds_per_unit", history.seconds_per_unit}};
  return json.dump(-1, ' ', false, Json::error_handler_t::replace);
}

absl::StatusOr<History> ParseHistory(const std::string& text) {
  const Json json = Json::parse(text, nullptr, /*allow_exceptions=*/false);
  Reader reader;
  History history;
  history.refusals = reader.ReadBackoff(reader.Child(json, "refusals"));
  history.deaths = reader.ReadBackoff(reader.Child(json, "deaths"));
  for (const Json& life : reader.Child(json, "counted_ends")) history.counted_ends.insert(reader.Text(life));
  history.period_start = reader.Time(json, "period_start");
  history.spent_core_seconds = reader.Number(json, "spent_core_seconds");
  for (const auto& [life, charge] : reader.Child(json, "charges").items()) {
    history.charges[life] = {.cores = reader.Number(charge, "cores"),
                             .from = reader.Time(charge, "from"),
                             .until = reader.Time(charge, "until")};
  }
  history.seconds_per_unit = reader.Number(json, "seconds_per_unit");
  if (!reader.ok()) return absl::DataLossError("the state of the autoscaler is not understood");
  return history;
}

absl::StatusOr<StateFile> StateFile::Open(const std::string& path) {
  // A file of its own: the other one is replaced by each write, and its lock with it.
  const std::string lock_path = path + ".lock";
  rpc::FileHandle lock(open(lock_path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, kMode));
  if (lock.get() < 0) return StorageError(lock_path, errno);
  if (flock(lock.get(), LOCK_EX | LOCK_NB) != 0)
    return absl::FailedPreconditionError(absl::StrCat(path, ": another autoscaler uses this state file"));
  return StateFile(path, std::move(lock));
}

absl::StatusOr<History> StateFile::Read() const {
  const absl::StatusOr<std::string> json = rpc::ReadCheckedFile(path_, kStateFile);
  if (absl::IsNotFound(json.status())) return History();
  if (!json.ok()) return json.status();
  absl::StatusOr<History> history = ParseHistory(*json);
  if (!history.ok()) return absl::DataLossError(absl::StrCat(path_, ": ", history.status().message()));
  return history;
}

absl::Status StateFile::Write(const History& history) {
  std::string json = HistoryJson(history);
  if (json == written_) return absl::OkStatus();
  if (absl::Status status = rpc::WriteCheckedFile(path_, kStateFile, json, RealFileSystem()); !status.ok())
    return status;
  written_ = std::move(json);
  return absl::OkStatus();
}

}  // namespace lumifold::autoscale
