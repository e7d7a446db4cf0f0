#include "client/cli/completion_script.h"

#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"

namespace lumifold::client {
namespace {

/// Text between single quotes of a shell.
std::string Quoted(const std::string& text) {
  return absl::StrCat("'", absl::StrReplaceAll(text, {{"'", "'\\''"}, {"\n", " "}}), "'");
}

/// The names of a command's options: all, or those whose value is a file (`files`) or something else.
std::string OptionNames(const CommandHelp& command, bool with_value, bool files) {
  std::string names;
  for (const OptionHelp& option : command.options) {
    const bool is_wanted =
        !with_value || (!option.value_name.empty() && OptionHelp::IsFile(option.value_name) == files);
    if (!is_wanted) continue;
    for (const std::string& name : option.names)
      absl::StrAppend(&names, names.empty() ? "" : with_value ? "|" : " ", name);
  }
  return names;
}

/// "[text]" of zsh's _arguments.
std::string ZshText(const std::string& text) {
  return absl::StrReplaceAll(text, {{"[", "\\["}, {"]", "\\]"}, {":", "\\:"}, {"\n", " "}});
}

std::string ZshSpec(const OptionHelp& option, const std::string& name) {
  const std::string value = option.value_name.empty()
                                ? ""
                                : absl::StrCat(":", ZshText(option.value_name), ":",
                                               OptionHelp::IsFile(option.value_name) ? "_files" : " ");
  if (option.is_argument()) return absl::StrCat(option.is_required ? "" : ":", value);
  return absl::StrCat("*", name, "[", ZshText(option.help), "]", value);
}

}  // namespace

std::string BashCompletion(const std::vector<CommandHelp>& commands) {
  std::string names;
  std::string cases;
  for (const CommandHelp& command : commands) {
    absl::StrAppend(&names, names.empty() ? "" : " ", command.name);
    absl::StrAppend(&cases, "    ", command.name,
                    ")\n      options=", Quoted(OptionNames(command, false, false)), "\n");
    const std::string files = OptionNames(command, true, true);
    const std::string others = OptionNames(command, true, false);
    if (!files.empty() || !others.empty()) {
      absl::StrAppend(&cases, "      case $before in\n");
      if (!files.empty()) absl::StrAppend(&cases, "        ", files, ") options= ;;\n");
      if (!others.empty()) absl::StrAppend(&cases, "        ", others, ") return ;;\n");
      absl::StrAppend(&cases, "      esac\n");
    }
    absl::StrAppend(&cases, "      ;;\n");
  }
  return absl::StrCat(
      "# Completion of lumifold for bash: source it, or put it into "
      "/usr/share/bash-completion/completions/lumifold.\n"
      "_lumifold() {\n"
      "  local word=${COMP_WORDS[COMP_CWORD]} before=${COMP_WORDS[COMP_CWORD-1]} options=\n"
      "  COMPREPLY=()\n"
      "  if [ \"$COMP_CWORD\" -eq 1 ]; then\n"
      "    COMPREPLY=($(compgen -W ",
      Quoted(absl::StrCat(names, " --help --version")),
      " -- \"$word\"))\n"
      "    return\n"
      "  fi\n"
      "  case ${COMP_WORDS[1]} in\n",
      cases,
      "  esac\n"
      "  if [[ $word == -* && -n $options ]]; then\n"
      "    COMPREPLY=($(compgen -W \"$options\" -- \"$word\"))\n"
      "  else\n"
      "    local IFS=$'\\n'\n"
      "    COMPREPLY=($(compgen -f -- \"$word\"))\n"
      "  fi\n"
      "}\n"
      "complete -o filenames -F _lumifold lumifold\n");
}

std::string ZshCompletion(const std::vector<CommandHelp>& commands) {
  std::string list;
  std::string cases;
  for (const CommandHelp& command : commands) {
    absl::StrAppend(&list, "    ", Quoted(absl::StrCat(command.name, ":", ZshText(command.summary))), "\n");
    absl::StrAppend(&cases, "    ", command.name, ")\n      _arguments");
    for (const OptionHelp& option : command.options) {
      for (const std::string& name : option.names)
        absl::StrAppend(&cases, " \\\n        ", Quoted(ZshSpec(option, name)));
      if (option.is_argument()) absl::StrAppend(&cases, " \\\n        ", Quoted(ZshSpec(option, "")));
    }
    absl::StrAppend(&cases, "\n      ;;\n");
  }
  return absl::StrCat(
      "#compdef lumifold\n"
      "# Completion of lumifold for zsh: put it into a folder of $fpath, as _lumifold.\n"
      "local -a commands\n"
      "commands=(\n",
      list,
      ")\n"
      "if (( CURRENT == 2 )); then\n"
      "  _describe command commands\n"
      "else\n"
      "  local command=$words[2]\n"
      "  shift words\n"
      "  (( CURRENT-- ))\n"
      "  case $command in\n",
      cases,
      "  esac\n"
      "fi\n");
}

std::string FishCompletion(const std::vector<CommandHelp>& commands) {
  std::string script =
      "# Completion of lumifold for fish: put it into ~/.config/fish/completions/lumifold.fish.\n"
      "complete -c lumifold -n __fish_use_subcommand -f\n";
  for (const CommandHelp& command : commands) {
    absl::StrAppend(&script, "complete -c lumifold -n __fish_use_subcommand -f -a ", command.name, " -d ",
                    Quoted(command.summary), "\n");
    for (const OptionHelp& option : command.options) {
      if (option.is_argument()) continue;
      absl::StrAppend(&script, "complete -c lumifold -n '__fish_seen_subcommand_from ", command.name, "'");
      for (const std::string& name : option.names)
        absl::StrAppend(&script, name.starts_with("--") ? " -l " + name.substr(2) : " -s " + name.substr(1));
      if (!option.value_name.empty())
        absl::StrAppend(&script, OptionHelp::IsFile(option.value_name) ? " -rF" : " -x");
      absl::StrAppend(&script, " -d ", Quoted(option.help), "\n");
    }
  }
  return script;
}

}  // namespace lumifold::client
