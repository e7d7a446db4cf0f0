#include "proto/rpc/checksum.h"

#include <xxhash.h>

namespace lumifold::rpc {

uint64_t Checksum(std::string_view bytes) { return XXH3_64bits(bytes.data(), bytes.size()); }

}  // namespace lumifold::rpc
