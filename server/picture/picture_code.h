#pragma once

#include <string>

namespace lumifold::server {

/// A hash of the code that renders, assembles, filters and writes pictures, with the versions of the
/// libraries that compress them. It is a part of the numeric class of workers of the same build.
std::string PictureCode();

/// Whether workers of this numeric class make the same file of the same units as this program, which filters
/// on a device of `other_bits` (filter::FilterDevice); empty: with the processor's.
bool SharesPictureCode(const std::string& numeric_class, const std::string& other_bits = "");

/// The class of a picture of units of `numeric_class` that is filtered with `other_bits`.
std::string ClassOfPicture(const std::string& numeric_class, const std::string& other_bits);

}  // namespace lumifold::server
