#include "client/reports/findings.h"

#include <nlohmann/json.hpp>
#include <set>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "client/cli/colour.h"
#include "client/cli/json_line.h"
#include "client/reports/farm_report.h"
#include "proto/rpc/version.h"

namespace lumifold::client {
namespace {

using Level = Finding::Level;

constexpr char kMachine[] = "this machine";
constexpr uint64_t kGigabyte = 1'000'000'000;
constexpr uint64_t kLeastTemporaryBytes = kGigabyte;
constexpr uint64_t kLeastMemoryBytes = 2 * kGigabyte;
constexpr uint64_t kLeastOpenFiles = 256;
constexpr uint64_t kLeastStorageBytes = 5 * kGigabyte;
constexpr absl::Duration kSoon = absl::Hours(7 * 24);

std::string Gigabytes(uint64_t bytes) {
  return absl::StrFormat("%.1f GB", static_cast<double>(bytes) / static_cast<double>(kGigabyte));
}

/// Ok, or a warning where `has` is less than `least`.
Finding Enough(const std::string& text, bool is_enough, const std::string& advice) {
  return {is_enough ? Level::kOk : Level::kWarning, kMachine, text, is_enough ? "" : advice};
}

/// A worker that does not render; nothing for one that does.
void AddTrouble(const v1::WorkerStatus& worker, Findings* findings) {
  const std::string state = std::string(WorkerStateName(worker.state()));
  const auto add = [&](const std::string& advice) {
    std::string text = absl::StrCat(worker.name(), " is ", state);
    if (!worker.reason().empty()) absl::StrAppend(&text, ": ", worker.reason());
    findings->push_back({Level::kWarning, "workers", text, advice});
  };
  switch (worker.state()) {
    case v1::WORKER_STATE_SILENT:
      return add("see whether its process hangs or its network is cut");
    case v1::WORKER_STATE_SET_ASIDE:
      return add("its units fail: 'lumifold logs " + worker.name() + "' has its last lines");
    case v1::WORKER_STATE_BLOCKED:
      return add("once it is repaired: lumifold readmit " + worker.name());
    default:
      return;
  }
}

}  // namespace

Findings AboutMachine(const MachineFacts& facts) {
  Findings findings;
  if (!facts.temporary_error.empty()) {
    findings.push_back({Level::kWrong, kMachine,
                        absl::StrCat("cannot write to ", facts.temporary_folder, ": ", facts.temporary_error),
                        "set TMPDIR to a folder that can be written"});
  } else {
    findings.push_back(Enough(absl::StrCat(Gigabytes(facts.free_bytes), " free in ", facts.temporary_folder),
                              facts.free_bytes >= kLeastTemporaryBytes,
                              "'render' keeps its films there: make room or set TMPDIR"));
  }
  findings.push_back(Enough(absl::StrCat(Gigabytes(facts.available_memory_bytes), " of memory available"),
                            facts.available_memory_bytes >= kLeastMemoryBytes,
                            "large scenes and pictures may not fit: end other programs"));
  findings.push_back(Enough(absl::StrCat("at most ", facts.open_files, " open files"),
                            facts.open_files >= kLeastOpenFiles, "raise it: ulimit -n 1024"));
  return findings;
}

Findings AboutDevices(const absl::StatusOr<std::vector<DeviceFacts>>& devices) {
  constexpr char kSubject[] = "devices";
  if (!devices.ok() || devices->empty()) {
    const std::string reason = devices.ok() ? "OpenCL has none" : std::string(devices.status().message());
    return {{Level::kOk, kSubject, absl::StrCat("the processor filters: ", reason)}};
  }
  Findings findings;
  for (size_t i = 0; i < devices->size(); ++i) {
    const DeviceFacts& device = (*devices)[i];
    const std::string text = absl::StrCat("gpu:", i, " is ", device.name, device.is_gpu ? "" : ", no GPU",
                                          ", ", Gigabytes(device.memory_bytes), ", ", device.driver);
    if (!device.refusal.empty())
      findings.push_back({Level::kNote, kSubject, absl::StrCat(text, ": does not filter: ", device.refusal)});
    else if (!device.other_bits.empty())
      findings.push_back(
          {Level::kNote, kSubject,
           absl::StrCat(text, ": filters with --allow-other-bits alone: ", device.other_bits)});
    else
      findings.push_back(
          {Level::kOk, kSubject,
           absl::StrCat(text, device.is_gpu ? ": filters" : ": filters if it is named, with --device")});
  }
  return findings;
}

Finding AboutProgram(const std::string& name, const absl::StatusOr<std::string>& version) {
  if (absl::IsNotFound(version.status()))
    return {Level::kNote, name, "is not installed here", "needed only where it runs"};
  if (!version.ok())
    return {Level::kWrong, name, std::string(version.status().message()), "install it again"};
  const std::string expected = absl::StrCat(name, " ", std::string(rpc::kVersion));
  if (version->substr(0, version->find(" (")) == expected)
    return {Level::kOk, name, absl::StrCat("version ", std::string(rpc::kVersion))};
  return {Level::kWarning, name,
          absl::StrCat("is '", *version, "', this is lumifold ", std::string(rpc::kVersion)),
          "install all programs in the same version"};
}

Finding AboutProfile(const std::string& name, const absl::StatusOr<absl::Time>& expiry, absl::Time now) {
  const std::string subject = absl::StrCat("profile ", name);
  const std::string again = absl::StrCat("log in again: lumifold login --profile ", name);
  if (!expiry.ok()) return {Level::kWrong, subject, std::string(expiry.status().message()), again};
  if (*expiry == absl::InfiniteFuture()) return {Level::kOk, subject, "has a token"};
  const std::string date = absl::FormatTime("%Y-%m-%d", *expiry, absl::UTCTimeZone());
  if (*expiry <= now) return {Level::kWrong, subject, absl::StrCat("its certificate ended on ", date), again};
  const bool is_soon = *expiry - now < kSoon;
  return {is_soon ? Level::kWarning : Level::kOk, subject,
          absl::StrCat("its certificate is good until ", date),
          is_soon ? "any command renews it; see whether the clock of this machine is right" : ""};
}

Findings AboutCoordinator(const std::string& address, bool is_named,
                          const absl::StatusOr<v1::ServerStatus>& status) {
  const std::string subject = absl::StrCat("coordinator ", address);
  if (!status.ok()) {
    if (!is_named)
      return {{Level::kNote, subject, "no coordinator is named, and none runs on this machine",
               "'render' needs none; for a farm: --server HOST:PORT, or lumifold login"}};
    const bool is_refused =
        absl::IsUnauthenticated(status.status()) || absl::IsPermissionDenied(status.status());
    return {{Level::kWrong, subject, std::string(status.status().message()),
             is_refused ? "ask its administrator for an invitation: lumifold login"
                        : "see whether lumifold-server runs there, and whether a firewall is between"}};
  }
  Findings findings;
  const std::string ours(rpc::kVersion);
  const bool is_same = status->version() == ours;
  findings.push_back(
      {is_same ? Level::kOk : Level::kWarning, subject,
       absl::StrCat("answers; version ", status->version(), is_same ? "" : ", this is " + ours),
       is_same ? "" : "install the same version"});
  if (!status->storage_error().empty()) {
    findings.push_back({Level::kWrong, subject, absl::StrCat("cannot write: ", status->storage_error()),
                        "nothing is rendered until its disk has room"});
  } else if (status->free_bytes() < kLeastStorageBytes) {
    findings.push_back({Level::kWarning, subject,
                        absl::StrCat(Gigabytes(status->free_bytes()), " left in its storage"),
                        "delete jobs: lumifold delete JOB"});
  }
  if (status->insecure())
    findings.push_back({Level::kNote, subject, "talks without encryption and access control",
                        "for machines besides this one: lumifold-server init"});
  return findings;
}

Finding AboutIdentity(const absl::StatusOr<v1::WhoAmIResponse>& caller) {
  constexpr char kSubject[] = "you";
  if (!caller.ok())
    return {Level::kWrong, kSubject, std::string(caller.status().message()), "lumifold login"};
  bool may_submit = false;
  for (const int scope : caller->scopes())
    may_submit = may_submit || scope == v1::ACCESS_SCOPE_SUBMIT || scope == v1::ACCESS_SCOPE_ADMIN;
  const std::string name = absl::StrCat("known as ", caller->name());
  if (may_submit) return {Level::kOk, kSubject, name};
  return {Level::kWarning, kSubject, absl::StrCat(name, ", who may look but not submit jobs"),
          "ask an administrator for an invitation with scope submit"};
}

Findings AboutWorkers(const absl::StatusOr<std::vector<v1::WorkerStatus>>& workers) {
  constexpr char kSubject[] = "workers";
  if (!workers.ok()) return {{Level::kWarning, kSubject, std::string(workers.status().message()), ""}};
  Findings findings;
  int connected = 0;
  std::set<std::string> classes;
  for (const v1::WorkerStatus& worker : *workers) {
    AddTrouble(worker, &findings);
    if (worker.state() == v1::WORKER_STATE_BLOCKED || worker.state() == v1::WORKER_STATE_SET_ASIDE) continue;
    ++connected;
    classes.insert(worker.numeric_class());
  }
  if (connected == 0) {
    findings.push_back({Level::kWrong, kSubject, "none is connected that may render",
                        "start lumifold-worker --server HOST:PORT on each machine that renders"});
    return findings;
  }
  findings.push_back(
      {Level::kOk, kSubject, absl::StrCat(connected, connected == 1 ? " renders" : " may render")});
  if (classes.size() > 1)
    findings.push_back(
        {Level::kNote, kSubject,
         absl::StrCat("are of ", classes.size(), " numeric classes: ", absl::StrJoin(classes, ", ")),
         "each job is rendered by one class; see 'submit --class'"});
  return findings;
}

const char* LevelName(Level level) {
  switch (level) {
    case Level::kOk:
      return "ok";
    case Level::kNote:
      return "note";
    case Level::kWarning:
      return "warning";
    case Level::kWrong:
      return "wrong";
  }
  return "unknown";
}

std::string FindingText(const Finding& finding, bool has_colours) {
  const Colour colour = finding.level == Level::kWrong     ? Colour::kRed
                        : finding.level == Level::kWarning ? Colour::kYellow
                                                           : Colour::kGreen;
  const std::string level = absl::StrFormat("%-8s", LevelName(finding.level));
  std::string text =
      absl::StrCat(Coloured(has_colours, colour, level), " ", finding.subject, ": ", finding.text, "\n");
  if (!finding.advice.empty()) absl::StrAppend(&text, std::string(9, ' '), "-> ", finding.advice, "\n");
  return text;
}

std::string FindingJson(const Finding& finding) {
  return JsonLine({{"level", LevelName(finding.level)},
                   {"subject", finding.subject},
                   {"text", finding.text},
                   {"advice", finding.advice}});
}

}  // namespace lumifold::client
