#pragma once

#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "client/cli/local_work.h"
#include "lumifold/v1/access.pb.h"
#include "lumifold/v1/farm.pb.h"

/// What `lumifold doctor` concludes from facts: no function here asks anybody.
namespace lumifold::client {

/// One line of a diagnosis.
struct Finding {
  enum class Level {
    kOk,
    kNote,     // not as usual, and no reason for trouble
    kWarning,  // works, but will not for long or not well
    kWrong,    // does not work
  };

  Level level = Level::kOk;
  std::string subject;  // "this machine", "coordinator a:7700"
  std::string text;
  /// What to do about it; empty where there is nothing to do.
  std::string advice = {};
};
using Findings = std::vector<Finding>;

/// Facts about this machine.
struct MachineFacts {
  std::string temporary_folder;
  /// Error of writing a file there; empty: none.
  std::string temporary_error;
  uint64_t free_bytes = 0;  // there
  uint64_t available_memory_bytes = 0;
  uint64_t open_files = 0;  // limit of this process
};
Findings AboutMachine(const MachineFacts& facts);

/// What may filter beside the processor. None is needed.
Findings AboutDevices(const absl::StatusOr<std::vector<DeviceFacts>>& devices);

/// A program beside this one. `version`: what its --version prints, or its error.
Finding AboutProgram(const std::string& name, const absl::StatusOr<std::string>& version);

/// A profile whose certificate ends at `expiry`; InfiniteFuture for one with a token.
Finding AboutProfile(const std::string& name, const absl::StatusOr<absl::Time>& expiry, absl::Time now);

/// `is_named`: the user has named an address, instead of the one that is used without.
Findings AboutCoordinator(const std::string& address, bool is_named,
                          const absl::StatusOr<v1::ServerStatus>& status);

Finding AboutIdentity(const absl::StatusOr<v1::WhoAmIResponse>& caller);

Findings AboutWorkers(const absl::StatusOr<std::vector<v1::WorkerStatus>>& workers);

/// "ok", "note", "warning", "wrong".
const char* LevelName(Finding::Level level);
/// A line, and a second one for the advice.
std::string FindingText(const Finding& finding, bool has_colours = false);
std::string FindingJson(const Finding& finding);

}  // namespace lumifold::client
