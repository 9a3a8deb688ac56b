#pragma once

#include <vector>

#include "base/observer.hpp"
#include "preparation/burning.hpp"
#include "preparation/prepare.hpp"

namespace hedgehop::preparation {

struct Settlements {
  std::vector<GeometryPointer> villages;  // and stand-alone buildings
  std::vector<GeometryPointer> settlements;
};

/// Joins built-up areas and buildings to settlements, as in the paper: each is grown, what then
/// overlaps is united and shrunk again, which closes streets and gaps; the pieces are split by
/// their area. Outlines are simplified by at most `tolerance_m`. Throws Interrupted.
Settlements settlements_of(const std::vector<const OGRGeometry*>& built_up,
                           const SettlementOptions& options, double tolerance_m,
                           Observer& observer);

/// The same pieces, each grown by a distance.
std::vector<GeometryPointer> grown(const std::vector<GeometryPointer>& pieces, double distance_m,
                                   Observer& observer);

}  // namespace hedgehop::preparation
