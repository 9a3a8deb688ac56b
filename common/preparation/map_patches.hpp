#pragma once

#include <string>
#include <vector>

#include "base/observer.hpp"
#include "map/map.hpp"
#include "map/patch.hpp"

namespace hedgehop::preparation {

struct PatchOptions {
  double drop_1pm = 0.0;  // drop_per_square_1pm() of the earth that observers look over
  int threads = 0;        // 0: one for each processor; never changes a byte
};

/// Why a patch cannot be put over a map: it lies outside, over unknown ground, crosses itself.
/// Empty if it can.
std::string reason_against(const map::Map& base, const map::Patch& patch);

/// The base map with things put over it, its hash included. Whatever the order in which things came
/// and went, the same things make the same map; none make the base map.
///
/// - An obstacle raises every cell that its cylinder touches to its top, as raise_obstacles() does
///   when a map is prepared with it, and joins Map::obstacles. Its height counts from the base
///   map's surface, since a map does not keep the highest ground of each cell. The visibility of
///   these cells is not known any more at their new height; they count as seen by all, which a
///   greater height can only come near to.
/// - An observer makes all cells seen over which it sees an aircraft: at the reference height, and
///   in each further band at its height, where lowest_seen_height() is not greater. Wires and
///   obstacles hide nothing; where they stand the ground does, since the map keeps no trees below
///   them. It joins Map::threats where these were read: a map without them stays one.
/// - An area joins Map::areas, of the kind "no_fly" (hard) or "avoid" (soft).
///
/// Areas, and obstacles on open ground, so come out as if the map had been prepared with them, but
/// for the visibility of the raised cells and what the source of an obstacle is called. Over trees
/// and houses an obstacle counts as higher.
///
/// @param patches  none against which reason_against() has a word; ids are unique.
/// @throws Interrupted
/// @note  A copy of the map and its hash, 15 ms for a million cells; an observer with a range of 10
///        km over 30 m cells 0.2 s more.
map::Map patched_map(const map::Map& base, std::vector<map::Patch> patches,
                     const PatchOptions& options, Observer& observer);

}  // namespace hedgehop::preparation
