#pragma once

#include <utility>

namespace lumifold {

/// URIs and the file names they stand for. The client names a job's files by its decoding, and the worker
/// looks them up by its own: the tests of both use these cases.
inline constexpr std::pair<const char*, const char*> kPercentDecodingCases[] = {
    {"wood%20floor+1.png", "wood floor+1.png"},
    {"a%2Fb", "a/b"},
    {"%C3%a4.bin", "\xC3\xA4.bin"},
    {"100%25.png", "100%.png"},
    {"%2541", "%41"},
    {"%", "%"},
    {"100%", "100%"},
    {"5%zz%4", "5%zz%4"},
    {"%%20", "% "},
};

}  // namespace lumifold
