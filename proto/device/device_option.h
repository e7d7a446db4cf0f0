#pragma once

#include <CLI/CLI.hpp>

namespace lumifold::device {

/// Of an option that is a word of filter::OpenFilterDevice.
CLI::Validator KnownDevice();

}  // namespace lumifold::device
