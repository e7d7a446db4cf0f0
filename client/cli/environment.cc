#include "client/cli/environment.h"

#include "absl/strings/str_replace.h"
#include "client/cli/colour.h"

namespace lumifold::client {

namespace {

void Print(const Environment& environment, const std::string& prefix, absl::string_view text) {
  environment.err << prefix << " " << absl::StrReplaceAll(text, {{"\n", " "}, {"\r", " "}}) << "\n"
                  << std::flush;
}

}  // namespace

void ReportLine(const Environment& environment, absl::string_view text) {
  Print(environment, "lumifold:", text);
}

ExitCode ReportError(const Environment& environment, const absl::Status& status) {
  Print(environment, Coloured(environment.terminal.err_has_colours, Colour::kRed, "lumifold:"),
        status.message());
  return ExitCodeFor(status);
}

}  // namespace lumifold::client
