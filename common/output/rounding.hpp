#pragma once

#include <cmath>

namespace hedgehop::output {

/// A number to the nearest part of one: rounded(x, 1e3) has three decimals.
inline double rounded(double value, double parts_of_one) {
  return std::round(value * parts_of_one) / parts_of_one;
}

}  // namespace hedgehop::output
