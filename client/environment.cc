#include "client/environment.h"

#include "absl/strings/str_replace.h"

namespace lumifold::client {

void ReportLine(const Environment& environment, absl::string_view text) {
  environment.err << "lumifold: " << absl::StrReplaceAll(text, {{"\n", " "}, {"\r", " "}}) << "\n"
                  << std::flush;
}

ExitCode ReportError(const Environment& environment, const absl::Status& status) {
  ReportLine(environment, status.message());
  return ExitCodeFor(status);
}

}  // namespace lumifold::client
