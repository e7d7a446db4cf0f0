#pragma once

#include <array>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "filter/image/exr_row_writer.h"
#include "server/film/result.h"
#include "server/film/unit_film.h"

namespace lumifold::film {

/// Writes the result of a frame (see BuildResult) in bands of rows, from the top down.
/// Errors: those of ExrRowWriter; with save_film, where the fragments are counted, also those of
/// UnitFilm::Read.
/// Threads: one at a time.
class ResultWriter {
 public:
  /// `files` must outlive it.
  static absl::StatusOr<ResultWriter> Create(const std::string& path, const UnitFilm& film, ResultInfo info,
                                             FileSystem* files = PrivateFileSystem());

  /// Writes the next rows: the output of UnitFilm::Read for them and the filtered picture.
  absl::Status Append(EdgedImage part, std::array<Plane, 3> filtered);
  /// Renames the complete file to its final name. Call it once, after all rows.
  absl::Status Finish() { return file_.Finish(); }

 private:
  ResultWriter(ExrRowWriter file, ResultInfo info);

  ExrRowWriter file_;
  ResultInfo info_;
  int rows_ = 0;
};

}  // namespace lumifold::film
