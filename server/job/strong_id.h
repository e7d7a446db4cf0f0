#pragma once

#include <compare>
#include <utility>

namespace lumifold::scheduler {

/// A value of type T that is the id of one kind of thing and of no other; Tag tells the kinds apart.
template <typename Tag, typename T>
class StrongId {
 public:
  StrongId() = default;
  explicit StrongId(T value) : value_(std::move(value)) {}

  const T& value() const { return value_; }

  friend auto operator<=>(const StrongId&, const StrongId&) = default;

 private:
  T value_{};
};

}  // namespace lumifold::scheduler
