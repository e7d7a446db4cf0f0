#pragma once

#include <string>

#include "absl/strings/string_view.h"
#include "lumifold/v1/farm.pb.h"

/// What operators see of a farm, as text and as JSON: one object in one line, without the newline, in UTF-8
/// (bytes that are not are replaced). docs/cli.md documents the fields of the objects; their meaning never
/// changes.
namespace lumifold::client {

/// "idle", "busy", "draining", "silent", "set aside", "blocked", "resting" or "gone"; "unknown" for a state
/// of a later version.
absl::string_view WorkerStateName(v1::WorkerState state);

/// A line of `lumifold workers`, and its header line. `of_several`: with the name of the coordinator that the
/// worker is connected to, on a farm of several.
std::string WorkerTableHead(bool of_several);
std::string WorkerTableLine(const v1::WorkerStatus& worker, bool of_several);
/// The last frames of a worker that was asked for, as a table; empty if it has none.
std::string HistoryText(const v1::WorkerStatus& worker);
std::string WorkerJson(const v1::WorkerStatus& worker);

/// The state of a job and the reasons why it does not run or runs slowly, one in each line.
std::string ExplanationText(const v1::ExplainJobResponse& explanation);
std::string ExplanationJson(const v1::ExplainJobResponse& explanation);

/// A line of `lumifold logs`.
std::string LogEventLine(const v1::LogEvent& event);
std::string LogEventJson(const v1::LogEvent& event);

/// Lines of "name: value".
std::string ServerStatusText(const v1::ServerStatus& status);
std::string ServerStatusJson(const v1::ServerStatus& status);

}  // namespace lumifold::client
