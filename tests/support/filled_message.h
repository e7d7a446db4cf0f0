#pragma once

#include <google/protobuf/descriptor.h>
#include <google/protobuf/message.h>

#include <string>

namespace lumifold {

/// Sets all fields of a message, and of those in it to a depth of four, each to a value that no other has:
/// what is left out of a copy or put in the place of another shows. Repeated fields get two values, and enums
/// one after the other of their values but the first. `next`: the first number that is not used.
inline void FillDistinct(google::protobuf::Message* message, int* next, int depth = 4) {
  using Field = google::protobuf::FieldDescriptor;
  const google::protobuf::Reflection& set = *message->GetReflection();
  const google::protobuf::Descriptor& type = *message->GetDescriptor();
  for (int i = 0; i < type.field_count(); ++i) {
    const Field* const field = type.field(i);
    for (int count = field->is_repeated() ? 2 : 1; count > 0; --count) {
      const bool adds = field->is_repeated();
      const int n = (*next)++;
      switch (field->cpp_type()) {
        case Field::CPPTYPE_INT32:
          adds ? set.AddInt32(message, field, n) : set.SetInt32(message, field, n);
          break;
        case Field::CPPTYPE_INT64:
          adds ? set.AddInt64(message, field, n) : set.SetInt64(message, field, n);
          break;
        case Field::CPPTYPE_UINT32:
          adds ? set.AddUInt32(message, field, static_cast<uint32_t>(n))
               : set.SetUInt32(message, field, static_cast<uint32_t>(n));
          break;
        case Field::CPPTYPE_UINT64:
          adds ? set.AddUInt64(message, field, static_cast<uint64_t>(n))
               : set.SetUInt64(message, field, static_cast<uint64_t>(n));
          break;
        case Field::CPPTYPE_DOUBLE:
          adds ? set.AddDouble(message, field, n + 0.25) : set.SetDouble(message, field, n + 0.25);
          break;
        case Field::CPPTYPE_FLOAT:
          adds ? set.AddFloat(message, field, static_cast<float>(n) + 0.5f)
               : set.SetFloat(message, field, static_cast<float>(n) + 0.5f);
          break;
        case Field::CPPTYPE_BOOL:
          adds ? set.AddBool(message, field, true) : set.SetBool(message, field, true);
          break;
        case Field::CPPTYPE_ENUM: {
          const auto* const value =
              field->enum_type()->value(1 + n % (field->enum_type()->value_count() - 1));
          adds ? set.AddEnum(message, field, value) : set.SetEnum(message, field, value);
          break;
        }
        case Field::CPPTYPE_STRING: {
          const std::string text = std::string(field->name()) + " " + std::to_string(n);
          adds ? set.AddString(message, field, text) : set.SetString(message, field, text);
          break;
        }
        case Field::CPPTYPE_MESSAGE:
          if (depth == 0) break;
          FillDistinct(adds ? set.AddMessage(message, field) : set.MutableMessage(message, field), next,
                       depth - 1);
          break;
      }
    }
  }
}

template <typename Message>
Message FilledMessage(int first) {
  Message message;
  FillDistinct(&message, &first);
  return message;
}

}  // namespace lumifold
