#pragma once

#include <string>

namespace lumifold::logging {

/// From now on a process that a library ends, by an exception that nobody catches or by abort(), says so in
/// one line on standard error and ends with exit code 1 instead of a signal: most of them end so where there
/// is no memory, or no thread. `program` begins the line. Call it once, before threads start.
void SayLastWords(const std::string& program);

}  // namespace lumifold::logging
