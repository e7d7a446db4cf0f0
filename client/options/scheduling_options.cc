#include "client/options/scheduling_options.h"

#include "proto/rpc/bounded_text.h"

namespace lumifold::client {
namespace {

constexpr int kMaxLeases = 1'000'000;

}  // namespace

void AddJobName(CommandLine& command_line, std::string* name) {
  command_line.AddText("--name", "NAME", name, "What the job is called (default: the scene's file)");
}

void SchedulingOptions::AddTo(CommandLine& command_line) {
  AddJobName(command_line, &name);
  command_line.AddWholeNumber("--priority", &priority, kMinPriority, kMaxPriority,
                              "Ten more doubles the job's share of the farm (default 0)");
  command_line.AddText("--user", "NAME", &user,
                       "Whose job it is; users share the farm equally (default $USER)");
  command_line.AddTexts("--tag", "TAG", &tags, "Only workers with this tag; may be repeated");
  command_line.AddWholeNumber("--max-leases", &max_leases, 1, kMaxLeases,
                              "Units that are rendered at a time, at most (default: no limit)");
  command_line.AddTexts("--after", "JOB", &after, "Start when this job is done; may be repeated");
  command_line.AddText("--class", "CLASS", &numeric_class,
                       "Only workers of this numeric class (default: that of the first unit)");
  command_line.AddFlag("--paused", &paused, "Submit it paused; see 'lumifold resume'");
  command_line.AddText("--webhook", "URL", &webhook,
                       "Call this URL when the job has ended; the farm's operator allows hosts");
  command_line.AddShare("--audit-share", &audit_share,
                        "Share of the units that two workers render, to find faulty ones (default 0)");
}

v1::Scheduling SchedulingOptions::ToProto() const {
  v1::Scheduling scheduling;
  scheduling.set_name(rpc::AsUtf8(name));
  scheduling.set_priority(priority);
  scheduling.set_user(user);
  for (const std::string& tag : tags) scheduling.add_tags(tag);
  scheduling.set_max_leases(max_leases);
  for (const std::string& job : after) scheduling.add_after(job);
  scheduling.set_numeric_class(numeric_class);
  scheduling.set_paused(paused);
  scheduling.set_webhook(rpc::AsUtf8(webhook));
  scheduling.set_audit_share(static_cast<double>(audit_share));
  return scheduling;
}

}  // namespace lumifold::client
