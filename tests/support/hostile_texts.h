#pragma once

#include <grpcpp/generic/generic_stub.h>
#include <grpcpp/grpcpp.h>

#include <string>

namespace lumifold {

/// Makes a call with one message, given as bytes, and reads at most one answer; OK where there is one.
grpc::StatusCode CallByPath(grpc::GenericStub* stub, const std::string& path, const std::string& bytes);

/// Makes every call of the protocol with tricks in each of its texts, and prints how many calls gave which
/// code. Returns false where a call gets no answer.
bool SendHostileTexts(const std::string& server);

}  // namespace lumifold
