#pragma once

#include <string>
#include <vector>

namespace lumifold::client {

/// An option or argument of a command, as its help shows it.
struct OptionHelp {
  /// Whether a value of this name is a file or folder.
  static bool IsFile(const std::string& value_name);

  /// {"-o", "--output"}; none for an argument.
  std::vector<std::string> names;
  /// "FILE", also of an argument; empty for flags.
  std::string value_name;
  std::string help;
  bool is_required = false;
  /// Each use adds a value.
  bool is_repeatable = false;
  /// Words that the value may be, which completion offers.
  std::vector<std::string> choices;

  bool is_argument() const { return names.empty(); }
  bool is_flag() const { return value_name.empty(); }
};

/// How the help of a command begins, and a use of it that the help shows.
struct CommandWords {
  std::string name;
  std::string summary;
  std::string example;  // after "lumifold"
};

/// What the help of a command says. Completion and man pages are made from it.
struct CommandHelp {
  std::string name;
  std::string summary;
  std::vector<OptionHelp> options;
  std::string footer;
};

}  // namespace lumifold::client
