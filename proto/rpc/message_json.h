#pragma once

#include <string>

namespace google::protobuf {
class Message;
}  // namespace google::protobuf

namespace lumifold::rpc {

/// A message as HTTP calls and webhooks tell it: names of fields as in the protocol, fields without presence
/// also where they are 0.
std::string JsonOf(const google::protobuf::Message& message);

}  // namespace lumifold::rpc
