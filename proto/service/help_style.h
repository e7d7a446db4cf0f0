#pragma once

namespace CLI {
class App;
}  // namespace CLI

namespace lumifold::service {

/// Makes the help of a program look like that of `lumifold`: names of values instead of their types and
/// ranges, defaults at the end of what an option does. To be called before options and subcommands are added.
void SetHelpStyle(CLI::App* app);

}  // namespace lumifold::service
