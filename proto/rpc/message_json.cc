#include "proto/rpc/message_json.h"

#include <google/protobuf/util/json_util.h>

namespace lumifold::rpc {

std::string JsonOf(const google::protobuf::Message& message) {
  google::protobuf::util::JsonPrintOptions options;
  options.always_print_primitive_fields = true;
  options.preserve_proto_field_names = true;
  std::string json;
  // Strings that are no UTF-8 do not come through gRPC, so that nothing can fail.
  (void)google::protobuf::util::MessageToJsonString(message, &json, options);
  return json;
}

}  // namespace lumifold::rpc
