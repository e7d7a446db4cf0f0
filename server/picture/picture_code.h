#pragma once

#include <string>

namespace lumifold::server {

/// A hash of the code that renders, assembles, filters and writes pictures, with the versions of the
/// libraries that compress them. It is a part of the numeric class of workers of the same build.
std::string PictureCode();

/// Whether workers of this numeric class make the same file of the same units as this program.
bool SharesPictureCode(const std::string& numeric_class);

}  // namespace lumifold::server
