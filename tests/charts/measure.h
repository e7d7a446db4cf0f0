#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "filter/image/edged_image.h"
#include "filter/image/parallel.h"
#include "filter/metrics/regions.h"
#include "tests/charts/method.h"
#include "tests/charts/row.h"
#include "tests/charts/row_store.h"

namespace lumifold::charts {

/// The reference that pictures are measured against.
struct Reference {
  std::string name;  // of its file; part of a row's key
  EdgedImage film;
  std::vector<metrics::Region> regions;
  double noise = 0;  // MSE255 of the reference itself, from its halves; 0 if it has none
  double rel_mse_noise = 0;
  bool has_halves = false;
};

/// Errors: kNotFound if the film has no noisy layer.
absl::StatusOr<Reference> MakeReference(std::string name, EdgedImage film);

/// Whether SSIM and FLIP would measure the noise of the reference rather than the picture: whether that noise
/// is more than a tenth of the picture's error. Both are MSE255, the error without that noise.
bool HidesStructure(double reference_noise, double error);

/// Measures a picture of the reference's size; SSIM and FLIP only if `is_thorough` and not HidesStructure().
Errors Judge(const ConstColorView& picture, const Reference& reference, bool is_thorough);

/// Adds the cost of a film to the row of a method that filters it: C, and auxiliary data if the method uses
/// any.
void AddRendering(const RenderRates& rates, const filter::MethodInfo& method, Row* row);

/// The methods to measure, and limits of cost.
struct MeasureOptions {
  std::vector<const Method*> methods;
  std::vector<std::string> again;  // methods that are measured again although rows are stored
  // Limits in processor seconds for the points without a stored row: for all of a method's grid on one film,
  // and for one point. A run that would exceed its limit is skipped.
  double most_grid_seconds = 120;
  double most_run_seconds = 600;
  int timed_runs = 3;  // of a default that takes little time; the minimum counts
};

/// Measures methods on films, each with its default and every point of its grid, and stores the rows. If a
/// grid would cost too much, its points with a stored row are used, the best point with fewer samples, and of
/// the others the first ones that fit.
class Meter {
 public:
  Meter(MeasureOptions options, RowStore* store, std::string cache_folder, TaskPool* pool);

  /// The rows of one film, method by method, with the best of each method marked. Seconds are those of the
  /// method only. Errors: those of the methods; kInvalidArgument for a reference of another size.
  absl::StatusOr<std::vector<Row>> Measure(Subject* subject, const Reference& reference);

 private:
  struct Call;

  absl::StatusOr<std::vector<Row>> MeasureMethod(Subject* subject, const Reference& reference,
                                                 const Method& method);
  absl::StatusOr<Row> FindOrRun(Subject* subject, const Reference& reference, const Call& call);
  absl::StatusOr<Row> Run(Subject* subject, const Reference& reference, const Call& call);
  absl::StatusOr<Fingerprint*> FingerprintFor(const Method& method, Subject* subject);
  absl::StatusOr<std::string> KeyOf(Subject* subject, const Reference& reference, const Call& call);
  absl::StatusOr<std::optional<Row>> FindKept(Subject* subject, const Reference& reference, const Call& call);
  absl::StatusOr<MadePicture> Make(Subject* subject, const Call& call);
  double ExpectedSeconds(const Subject& subject, const Method& method) const;
  absl::StatusOr<std::vector<std::vector<float>>> PointsOf(Subject* subject, const Reference& reference,
                                                           const Method& method, double seconds);

  MeasureOptions options_;
  RowStore* store_;
  std::string cache_folder_;
  TaskPool* pool_;
  std::map<std::string, Fingerprint> fingerprints_;        // by method, of the film that is measured
  std::map<std::string, Fingerprint> small_fingerprints_;  // by method, for Probe::kSmallFilms
  struct Last {
    double seconds = 0;  // of the default
    FilmSettings settings;
    std::vector<float> best;
  };
  std::map<std::string, Last> last_;  // by scene and method: cost and best point of the previous film
};

}  // namespace lumifold::charts
