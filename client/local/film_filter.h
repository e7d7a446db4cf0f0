#pragma once

#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client/cli/local_work.h"
#include "filter/image/film_source.h"

namespace lumifold::local {

/// Implements client::FilmFilter with the filter library.
absl::Status FilterFilm(FilmSource* film, const std::string& method, const client::FilterMachine& machine,
                        const std::vector<std::string>& passed_on, const RowSink& sink,
                        const std::function<void(double share)>& progress);

/// Implements client::DeviceLister.
absl::StatusOr<std::vector<client::DeviceFacts>> ListDevices();

/// The text of the `lumifold` program about the filter's methods.
client::MethodTexts DescribeMethods();

}  // namespace lumifold::local
