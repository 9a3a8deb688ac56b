#pragma once

#include <cstdint>
#include <iostream>
#include <random>

namespace hedgehop::test {

/// A new seed for a random test, printed so that a failure can be repeated.
inline std::uint64_t fresh_seed() {
  std::random_device device;
  const std::uint64_t seed = (static_cast<std::uint64_t>(device()) << 32U) ^ device();
  std::cout << "seed " << seed << "\n";
  return seed;
}

}  // namespace hedgehop::test
