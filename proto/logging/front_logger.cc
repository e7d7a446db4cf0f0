#include "proto/logging/front_logger.h"

#include <spdlog/logger.h>
#include <spdlog/sinks/base_sink.h>

#include <algorithm>
#include <mutex>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "proto/logging/fields.h"
#include "proto/logging/job_labels.h"
#include "proto/logging/json_formatter.h"

namespace lumifold::logging {
namespace {

class FrontSink final : public spdlog::sinks::base_sink<std::mutex> {
 public:
  explicit FrontSink(FrontOptions options) : options_(std::move(options)), limit_(options_.limits) {}

  ~FrontSink() override {
    limit_.EndSecond();
    PassDropped(std::chrono::system_clock::now());
  }

 private:
  void sink_it_(const spdlog::details::log_msg& message) override {
    const std::string_view text(message.payload.data(), message.payload.size());
    const bool admitted = limit_.Admit(message.time, message.level < spdlog::level::info, EventOf(text));
    PassDropped(message.time);
    if (admitted) Pass(message, text);
  }
  void flush_() override { options_.log->flush(); }

  void PassDropped(std::chrono::system_clock::time_point time) {
    for (const EventLimit::Dropped& dropped : limit_.TakeDropped()) {
      const std::string text =
          absl::StrCat("event=lines_dropped of=", dropped.event, " count=", dropped.lines);
      Pass({time, {}, options_.log->name(), spdlog::level::warn, text}, text);
    }
  }

  void Pass(spdlog::details::log_msg message, std::string_view text) {
    std::string labelled(text);
    Line parsed = ParseLine(text);
    if (const std::string added = Label(parsed); !added.empty()) {
      labelled += added;
      parsed = ParseLine(labelled);
    }
    message.payload = {labelled.data(), labelled.size()};
    const bool goes_on = options_.log->should_log(message.level);
    if (goes_on) {
      for (const spdlog::sink_ptr& target : options_.log->sinks()) target->log(message);
    }
    if (options_.keep != nullptr && (goes_on || message.level >= spdlog::level::info))
      options_.keep({message.time, LevelName(message.level), labelled, parsed});
  }

  /// What is added to a line.
  std::string Label(const Line& line) {
    if (options_.labels == nullptr) return "";
    std::string added;
    if (const std::string worker = options_.labels->worker(); !worker.empty() && line.Get("worker").empty())
      absl::StrAppend(&added, " worker=", worker);
    const std::string job = JobOf(line);
    const JobLabel label = job.empty() ? JobLabel() : options_.labels->Of(job);
    if (label == JobLabel()) return added;
    if (line.Get("job").empty()) absl::StrAppend(&added, " job=", job);
    if (!label.user.empty()) absl::StrAppend(&added, " user=", Quoted(label.user));
    if (!label.trace.empty()) absl::StrAppend(&added, " trace=", label.trace);
    return added;
  }

  const FrontOptions options_;
  EventLimit limit_;
};

}  // namespace

std::shared_ptr<spdlog::logger> MakeFrontLogger(FrontOptions options) {
  const std::string name = options.log->name();
  const auto level =
      options.keep == nullptr ? options.log->level() : std::min(options.log->level(), spdlog::level::info);
  auto logger = std::make_shared<spdlog::logger>(name, std::make_shared<FrontSink>(std::move(options)));
  logger->set_level(level);
  return logger;
}

}  // namespace lumifold::logging
