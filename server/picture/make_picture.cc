#include "server/picture/make_picture.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <optional>
#include <utility>
#include <vector>

#include "filter/image/layers.h"
#include "filter/manifold/filter_device.h"
#include "filter/methods.h"
#include "proto/sandbox/sandbox.h"
#include "server/film/matte.h"
#include "server/film/result_writer.h"
#include "server/film/unit_film.h"
#include "server/picture/filtered_round.h"
#include "server/picture/picture_code.h"

namespace lumifold::server {
namespace {

/// Of a process without a film.
constexpr uint64_t kProcessBytes = uint64_t{64} << 20;
/// Of the film and the filter together: 4.4 GB for a block of 1536x1536 pixels of a scene with reflections
/// (docs/operations.md); 700 for the Cornell box.
constexpr uint64_t kBytesPerPixel = 1900;
/// Of the filter's time, that of shadows: 1.3 s of 5.4 s of a frame of 1024x768 pixels. They are one further
/// layer, on a plane that has nothing of the picture's features, so that no filtering serves both. It only
/// moves the progress.
constexpr double kShadowShare = 0.25;

/// Measures the time of alternating stages.
class StageClock {
 public:
  enum Stage { kAssemble, kFilter, kWrite, kStages };

  explicit StageClock(const std::function<absl::Time()>& now) : now_(now), since_(now()) {}

  /// Adds the time since the last call, or since construction, to `stage`.
  void Charge(Stage stage) {
    const absl::Time now = now_();
    spent_[stage] += now - since_;
    since_ = now;
  }

  v1::StageTimes Times() const {
    v1::StageTimes times;
    times.set_assemble_seconds(absl::ToDoubleSeconds(spent_[kAssemble]));
    times.set_filter_seconds(absl::ToDoubleSeconds(spent_[kFilter]));
    times.set_write_seconds(absl::ToDoubleSeconds(spent_[kWrite]));
    return times;
  }

 private:
  const std::function<absl::Time()>& now_;
  absl::Time since_;
  std::array<absl::Duration, kStages> spent_;
};

/// A film whose reads are charged to assembly, and the time between them to the filter.
TimedFilm MakeTimedFilm(FilmSource* film, StageClock* clock) {
  const auto before = [clock] {
    clock->Charge(StageClock::kFilter);
    return absl::OkStatus();
  };
  return {film, before, [clock] { clock->Charge(StageClock::kAssemble); }};
}

/// The part of the filtered `rows` inside `rect`.
std::array<Plane, 3> PictureIn(const LayeredImage& rows, const Rect& rect) {
  const ConstColorView color = rows.GetColor(layers::kBeauty);
  std::array<Plane, 3> picture;
  for (size_t c = 0; c < picture.size(); ++c) {
    picture[c] = Plane::Uninitialized(rect.width(), rect.height());
    CopyPlane(color[c].Crop(rect), picture[c].view());
  }
  return picture;
}

/// The progress of a part of the work as that of all.
FilterProgress PartOf(const FilterProgress& progress, double from, double to) {
  if (!progress) return nullptr;
  return [&progress, from, to](double share) { progress(from + share * (to - from)); };
}

/// That of the colours, before the shadows.
FilterProgress OfColours(const FilterProgress& progress, bool catches_shadows) {
  return PartOf(progress, 0, catches_shadows ? 1 - kShadowShare : 1);
}

/// Filters a frame and writes its result.
class Finish {
 public:
  /// `catches_shadows`: A has filtered shadows.
  Finish(film::UnitFilm* film, film::ResultWriter* result, std::string method, bool catches_shadows,
         TaskPool* pool, const FilterProgress& progress, StageClock* clock)
      : film_(*film),
        timed_(MakeTimedFilm(film, clock)),
        result_(*result),
        method_(std::move(method)),
        catches_shadows_(catches_shadows),
        pool_(pool),
        progress_(progress),
        clock_(*clock) {}

  /// For a frame of one block: the film is read once.
  absl::Status Whole() {
    absl::StatusOr<EdgedImage> film = timed_.Read({0, 0, film_.width(), film_.height()});
    if (!film.ok()) return film.status();
    absl::StatusOr<std::array<Plane, 3>> filtered = filter::FilterFilm(
        film->pixels, method_, pool_, &film->edges, &film->fragments, OfColours(progress_, catches_shadows_));
    if (!filtered.ok()) return filtered.status();
    return WriteWhole(*std::move(film), *std::move(filtered));
  }

  /// For a frame that was filtered before.
  absl::Status Filtered(FilteredRound frame) {
    return WriteWhole(std::move(frame.film), std::move(frame.filtered.picture));
  }

  /// For a frame of several blocks: the other layers of the result are read again when the rows of the
  /// picture are filtered. Keeping them would need the memory of a row of blocks with all channels.
  absl::Status InRows(const filter::BlockParams& blocks, const filter::ReadyBlocks& ready) {
    if (catches_shadows_) {
      film::ShadowFilm shadows(&timed_);
      absl::StatusOr<Picture> filtered =
          filter::FilterFilmByRows(&shadows, method_, pool_, blocks, PartOf(progress_, 0, kShadowShare));
      if (!filtered.ok()) return filtered.status();
      shadow_ = std::move((*filtered)[0]);
    }
    const auto write = [this](const LayeredImage& rows) { return WriteRows(rows); };
    return filter::FilterFilmInRows(&timed_, method_, {}, pool_, write, blocks, ready,
                                    PartOf(progress_, catches_shadows_ ? kShadowShare : 0, 1));
  }

 private:
  absl::Status WriteWhole(EdgedImage film, std::array<Plane, 3> filtered) {
    if (catches_shadows_) {
      absl::StatusOr<Picture> shadow =
          filter::FilterFilm(film::ShadowFilmOf(film.pixels), method_, pool_, nullptr, nullptr,
                             PartOf(progress_, 1 - kShadowShare, 1));
      if (!shadow.ok()) return shadow.status();
      film.pixels.Add(layers::kShadow, std::move((*shadow)[0]));
    }
    clock_.Charge(StageClock::kFilter);
    return Write(std::move(film), std::move(filtered));
  }

  absl::Status WriteRows(const LayeredImage& rows) {
    const int first = y_;
    while (y_ < first + rows.height()) {
      const Rect band = {0, y_, film_.width(), std::min(first + rows.height(), film_.BandEnd(y_))};
      absl::StatusOr<EdgedImage> part = timed_.Read(band);
      if (!part.ok()) return part.status();
      if (catches_shadows_)
        CopyPlane(std::as_const(shadow_).view().Crop(band), part->pixels.Add(layers::kShadow));
      absl::Status status = Write(*std::move(part), PictureIn(rows, SeenFrom(0, first, band)));
      if (!status.ok()) return status;
      y_ = band.y1;
    }
    return absl::OkStatus();
  }

  absl::Status Write(EdgedImage part, std::array<Plane, 3> filtered) {
    absl::Status status = result_.Append(std::move(part), std::move(filtered));
    clock_.Charge(StageClock::kWrite);
    return status;
  }

  const film::UnitFilm& film_;
  TimedFilm timed_;
  film::ResultWriter& result_;
  const std::string method_;
  const bool catches_shadows_;
  TaskPool* const pool_;
  const FilterProgress& progress_;
  StageClock& clock_;
  Plane shadow_;  // of the frame, where it is written in rows
  int y_ = 0;     // first row that is not written
};

/// The picture that MakeBlock has made as `bytes`.
absl::StatusOr<Picture> PictureOf(const std::string& bytes, const Rect& rect) {
  const auto plane_bytes =
      static_cast<size_t>(rect.width()) * static_cast<size_t>(rect.height()) * sizeof(float);
  Picture picture;
  if (bytes.size() != picture.size() * plane_bytes)
    return absl::DataLossError("the picture of a block has not the size of the block");
  const char* from = bytes.data();
  for (Plane& plane : picture) {
    plane = Plane::Uninitialized(rect.width(), rect.height());
    for (int y = 0; y < rect.height(); ++y) {
      const size_t row_bytes = static_cast<size_t>(rect.width()) * sizeof(float);
      std::memcpy(plane.Row(y), from, row_bytes);
      from += row_bytes;
    }
  }
  return picture;
}

filter::ReadyBlocks ReadyBlocksOf(const CompleteFrame& frame, const filter::BlockParams& params) {
  if (frame.ready_blocks == nullptr) return nullptr;
  return [&frame, blocks = FrameBlocks(frame.spec, params)](
             int column, int row) -> absl::StatusOr<std::optional<std::vector<Picture>>> {
    const int number = blocks.NumberOf(column, row);
    const absl::StatusOr<std::optional<std::string>> bytes = frame.ready_blocks(number);
    if (!bytes.ok()) return bytes.status();
    if (!bytes->has_value()) return std::nullopt;
    absl::StatusOr<Picture> picture = PictureOf(**bytes, blocks.Output(number));
    if (!picture.ok()) return picture.status();
    std::vector<Picture> pictures;
    pictures.push_back(*std::move(picture));
    return pictures;
  };
}

/// A frame with adaptive sampling whose error has been estimated.
struct EstimatedFrame {
  FilteredRound last;
  double error = 0;
};

/// The last round of a frame, with the error of its picture.
absl::StatusOr<EstimatedFrame> Estimated(const v1::JobSpec& spec, int32_t frame,
                                         const job::FrameRounds& rounds, const film::UnitSource& units,
                                         TaskPool* pool, const FilterProgress& progress) {
  absl::StatusOr<FilteredRound> last = FilterRound(spec, frame, rounds, rounds.count() - 1, units,
                                                   filter::FilterPurpose::kPicture, pool, progress);
  if (!last.ok()) return last.status();
  const double error = rounds.MeasuredError(ErrorsOf(*last, spec, pool));
  return EstimatedFrame{*std::move(last), error};
}

}  // namespace

absl::StatusOr<v1::FrameReport> MakePicture(const CompleteFrame& frame, const PictureFile& file,
                                            TaskPool* pool, const std::function<absl::Time()>& now,
                                            const filter::BlockParams& blocks) {
  StageClock clock(now);
  const job::FrameRounds* const rounds = frame.rounds;
  absl::StatusOr<film::UnitFilm> film = film::UnitFilm::Open(
      frame.spec, frame.frame, &frame.units, pool,
      rounds != nullptr ? film::FilmRounds{rounds, rounds->count()} : film::FilmRounds());
  if (!film.ok()) return film.status();
  clock.Charge(StageClock::kAssemble);
  film::ResultInfo info = {.spec = frame.spec, .frame = frame.frame, .numeric_class = frame.numeric_class};
  if (const filter::FilterDevice* const device = filter::DeviceOf(pool))
    info.numeric_class = ClassOfPicture(frame.numeric_class, device->OtherBits());
  absl::StatusOr<film::UnitOutline> first = frame.units.Outline({frame.frame, 0, 0, v1::UNIT_KIND_GEOMETRY});
  if (!first.ok()) return first.status();
  info.facts = std::move(first->stats);
  const bool catches_shadows = info.facts.catches_shadows();
  std::optional<EstimatedFrame> estimated;
  if (rounds != nullptr) {
    absl::StatusOr<EstimatedFrame> made = Estimated(frame.spec, frame.frame, *rounds, frame.units, pool,
                                                    OfColours(frame.progress, catches_shadows));
    if (!made.ok()) return made.status();
    estimated = *std::move(made);
    info.estimated_error = estimated->error;
    info.schedule = rounds->schedule();
    clock.Charge(StageClock::kFilter);
  }
  absl::StatusOr<film::ResultWriter> result = film::ResultWriter::Create(file.path, *film, info, file.files);
  if (!result.ok()) return result.status();
  clock.Charge(StageClock::kWrite);
  Finish finish(&*film, &*result, frame.spec.filter().method(), catches_shadows, pool, frame.progress,
                &clock);
  const bool is_one_block = filter::BlockGrid(film->width(), film->height(), blocks).IsOneBlock();
  const absl::Status written = estimated.has_value() ? finish.Filtered(std::move(estimated->last))
                               : is_one_block        ? finish.Whole()
                                                     : finish.InRows(blocks, ReadyBlocksOf(frame, blocks));
  if (!written.ok()) return written;
  if (absl::Status status = file.may_commit(); !status.ok()) return status;
  if (absl::Status status = result->Finish(); !status.ok()) return status;
  clock.Charge(StageClock::kWrite);
  v1::FrameReport report;
  *report.mutable_times() = clock.Times();
  if (info.estimated_error.has_value()) report.set_estimated_error(*info.estimated_error);
  return report;
}

FrameBlocks::FrameBlocks(const v1::JobSpec& spec, const filter::BlockParams& params)
    : grid_(spec.width(), spec.height(), params) {}

uint64_t FrameBlocks::PictureBytes(int number) const {
  const Rect rect = Output(number);
  return 3 * sizeof(float) * static_cast<uint64_t>(rect.width()) * static_cast<uint64_t>(rect.height());
}

absl::StatusOr<std::string> MakeBlock(const CompleteFrame& frame, int block, const film::LevelSet& levels,
                                      TaskPool* pool, const filter::BlockParams& params) {
  static_assert(std::endian::native == std::endian::little);
  const FrameBlocks blocks(frame.spec, params);
  const Rect input = blocks.Input(block);
  film::UnitFilm film = film::UnitFilm::OpenPart(frame.spec, frame.frame, &frame.units, pool, levels);
  const absl::StatusOr<EdgedImage> part = film.Read(input);
  if (!part.ok()) return part.status();
  const absl::StatusOr<Picture> filtered = filter::FilterFilm(
      part->pixels, frame.spec.filter().method(), pool, &part->edges, &part->fragments, frame.progress);
  if (!filtered.ok()) return filtered.status();
  const Rect output = SeenFrom(input.x0, input.y0, blocks.Output(block));
  std::string bytes;
  bytes.reserve(blocks.PictureBytes(block));
  for (const Plane& plane : *filtered) {
    for (int y = output.y0; y < output.y1; ++y)
      bytes.append(reinterpret_cast<const char*>(plane.Row(y) + output.x0),
                   static_cast<size_t>(output.width()) * sizeof(float));
  }
  return bytes;
}

uint64_t PictureMemoryOf(const v1::JobSpec& spec) {
  const int64_t frame = int64_t{spec.width()} * spec.height();
  // With adaptive sampling all of the frame at once, before a round and after it.
  const int64_t pixels = spec.has_adaptive() ? 2 * frame : std::min(frame, filter::BlockParams().whole);
  return kProcessBytes + static_cast<uint64_t>(pixels) * kBytesPerPixel;
}

uint64_t MemoryForPictures() { return sandbox::UsableMemoryBytes() / 2; }

}  // namespace lumifold::server
