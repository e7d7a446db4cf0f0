#include "client/cli/man_page.h"

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/str_split.h"
#include "client/cli/exit_code.h"
#include "proto/rpc/version.h"

namespace lumifold::client {
namespace {

/// Text of a page: no line of it is a request of roff, and hyphens are those that are typed.
std::string Text(const std::string& text) {
  const std::string escaped = absl::StrReplaceAll(text, {{"\\", "\\e"}, {"-", "\\-"}});
  std::vector<std::string> lines = absl::StrSplit(escaped, '\n');
  for (std::string& line : lines) {
    if (line.starts_with('.') || line.starts_with('\'')) line.insert(0, "\\&");
  }
  return absl::StrJoin(lines, "\n");
}

std::string Head(const std::string& name, const std::string& summary) {
  return absl::StrCat(".TH ", absl::AsciiStrToUpper(Text(name)), " 1 \"\" \"Lumifold ",
                      std::string(rpc::kVersion), "\" \"Lumifold\"\n.SH NAME\n", Text(name), " \\- ",
                      Text(summary), "\n");
}

std::string Synopsis(const CommandHelp& command) {
  std::string text = absl::StrCat(".B lumifold ", Text(command.name), "\n[\\fIOPTIONS\\fR]\n");
  for (const OptionHelp& option : command.options) {
    if (!option.is_argument()) continue;
    absl::StrAppend(&text, option.is_required ? "" : "[", "\\fI", Text(option.value_name), "\\fR",
                    option.is_required ? "" : "]", "\n");
  }
  return text;
}

std::string Item(const OptionHelp& option) {
  std::string text = ".TP\n";
  if (option.is_argument()) {
    absl::StrAppend(&text, "\\fI", Text(option.value_name), "\\fR");
  } else {
    absl::StrAppend(&text, "\\fB", Text(absl::StrJoin(option.names, ", ")), "\\fR");
    if (!option.value_name.empty()) absl::StrAppend(&text, " \\fI", Text(option.value_name), "\\fR");
  }
  return absl::StrCat(text, "\n", Text(option.help), option.is_required ? " (required)" : "", "\n");
}

/// Its lines stay as they are.
std::string Unfilled(const std::string& text) { return absl::StrCat(".nf\n", Text(text), "\n.fi\n"); }

}  // namespace

std::string ManPage(const CommandHelp& command) {
  std::string page = absl::StrCat(Head("lumifold-" + command.name, command.summary), ".SH SYNOPSIS\n",
                                  Synopsis(command), ".SH OPTIONS\n");
  for (const OptionHelp& option : command.options) absl::StrAppend(&page, Item(option));
  absl::StrAppend(&page, ".SH NOTES\n", Unfilled(command.footer), ".SH SEE ALSO\n.BR lumifold (1)\n");
  return page;
}

std::string ManPage(const std::vector<CommandHelp>& commands) {
  std::string page =
      absl::StrCat(Head("lumifold", "render glTF scenes on this machine or on a farm"),
                   ".SH SYNOPSIS\n.B lumifold\n\\fICOMMAND\\fR [\\fIOPTIONS\\fR]\n.SH COMMANDS\n");
  for (const CommandHelp& command : commands)
    absl::StrAppend(&page, ".TP\n.BR lumifold\\-", Text(command.name), " (1)\n", Text(command.summary), "\n");
  absl::StrAppend(&page, ".SH EXIT STATUS\n", Unfilled(kExitCodesHelp));
  return page;
}

}  // namespace lumifold::client
