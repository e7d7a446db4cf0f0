#include "server/storage/retention.h"

#include <limits>

#include "absl/strings/str_cat.h"

namespace lumifold::server {

using job::JobId;

void Retention::JobEnded(const JobId& job, absl::Time ended, uint64_t film_bytes, uint64_t result_bytes) {
  Forget(job);
  jobs_.emplace(job, EndedJob{ended, film_bytes, result_bytes});
  by_end_.emplace(ended, job);
  if (film_bytes > 0) films_by_end_.emplace(ended, job);
  film_bytes_ += film_bytes;
  result_bytes_ += result_bytes;
}

void Retention::FrameFinished(const JobId& job, int32_t frame, absl::Time finished, uint64_t film_bytes) {
  FrameRemoved(job, frame);
  frames_.emplace(FrameKey{job, frame}, FinishedFrame{finished, film_bytes});
  frames_by_end_.emplace(finished, FrameKey{job, frame});
  film_bytes_ += film_bytes;
}

void Retention::FilmRemoved(const JobId& job) {
  const auto found = jobs_.find(job);
  if (found == jobs_.end()) return;
  films_by_end_.erase({found->second.ended, job});
  film_bytes_ -= found->second.film_bytes;
  found->second.film_bytes = 0;
}

void Retention::FrameRemoved(const JobId& job, int32_t frame) {
  const auto found = frames_.find({job, frame});
  if (found == frames_.end()) return;
  frames_by_end_.erase({found->second.finished, found->first});
  film_bytes_ -= found->second.film_bytes;
  frames_.erase(found);
}

void Retention::Forget(const JobId& job) {
  FilmRemoved(job);
  if (const auto found = jobs_.find(job); found != jobs_.end()) {
    by_end_.erase({found->second.ended, job});
    result_bytes_ -= found->second.result_bytes;
    jobs_.erase(found);
  }
  const auto first = frames_.lower_bound({job, std::numeric_limits<int32_t>::min()});
  for (auto it = first; it != frames_.end() && it->first.first == job;) {
    frames_by_end_.erase({it->second.finished, it->first});
    film_bytes_ -= it->second.film_bytes;
    it = frames_.erase(it);
  }
}

std::optional<Removal> Retention::OldestFilm(std::string cause) const {
  if (!films_by_end_.empty())
    return Removal{Removal::What::kFilm, films_by_end_.begin()->second, 0, std::move(cause)};
  if (frames_by_end_.empty()) return std::nullopt;
  const auto& [job, frame] = frames_by_end_.begin()->second;
  return Removal{Removal::What::kFrame, job, frame, std::move(cause)};
}

std::optional<Removal> Retention::OldestJob(std::string cause) const {
  for (const auto& [ended, job] : by_end_) {
    if (!needed_.contains(job)) return Removal{Removal::What::kJob, job, 0, std::move(cause)};
  }
  return std::nullopt;
}

std::optional<Removal> Retention::Next(absl::Time now, uint64_t free_bytes) const {
  std::optional<Removal> removal = OldestJob("it ended long enough ago");
  const bool is_limited = limits_.keep_results < absl::InfiniteDuration();
  if (is_limited && removal.has_value() && jobs_.at(removal->job).ended + limits_.keep_results <= now)
    return removal;
  if (film_bytes_ > limits_.film_bytes) {
    removal = OldestFilm(absl::StrCat("films use ", film_bytes_, " bytes of ", limits_.film_bytes));
    if (removal.has_value()) return removal;
  }
  if (free_bytes < limits_.free_bytes) {
    removal =
        OldestFilm(absl::StrCat("the disk has ", free_bytes, " bytes free, less than ", limits_.free_bytes));
    if (removal.has_value()) return removal;
  }
  if (!limits_.quota_bytes.has_value() || used_bytes() <= *limits_.quota_bytes) return std::nullopt;
  const std::string cause =
      absl::StrCat("the data folder uses ", used_bytes(), " bytes of a quota of ", *limits_.quota_bytes);
  removal = OldestFilm(cause);
  return removal.has_value() ? removal : OldestJob(cause);
}

}  // namespace lumifold::server
