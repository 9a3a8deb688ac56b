#pragma once

#include <array>

namespace hedgehop::global_planning {

inline constexpr int kLatticeDirections = 16;

/// Columns and rows of one step in each direction of a lattice, counter-clockwise from east.
inline constexpr std::array<std::array<int, 2>, kLatticeDirections> kLatticeStep = {{{1, 0},
                                                                                     {2, 1},
                                                                                     {1, 1},
                                                                                     {1, 2},
                                                                                     {0, 1},
                                                                                     {-1, 2},
                                                                                     {-1, 1},
                                                                                     {-2, 1},
                                                                                     {-1, 0},
                                                                                     {-2, -1},
                                                                                     {-1, -1},
                                                                                     {-1, -2},
                                                                                     {0, -1},
                                                                                     {1, -2},
                                                                                     {1, -1},
                                                                                     {2, -1}}};

}  // namespace hedgehop::global_planning
