#include "preparation/ground_weights.hpp"

#include <cmath>

#include "map/map.hpp"

namespace hedgehop::preparation {
namespace {

std::uint16_t bits(std::initializer_list<map::SemanticClass> classes) {
  std::uint16_t sum = 0;
  for (const map::SemanticClass one : classes) {
    sum = static_cast<std::uint16_t>(sum | static_cast<std::uint16_t>(one));
  }
  return sum;
}

}  // namespace

raster::Grid<std::uint8_t> ground_weights(const raster::Grid<std::uint16_t>& semantics,
                                          const GroundWeights& weights) {
  using map::SemanticClass;
  if (weights.forest == 1.0 && weights.urban == 1.0 && weights.water == 1.0 &&
      weights.open == 1.0) {
    return {};
  }
  const std::uint16_t urban = bits({SemanticClass::kBuilding, SemanticClass::kBuiltUpArea,
                                    SemanticClass::kVillage, SemanticClass::kSettlement});
  const std::uint16_t water = bits({SemanticClass::kWater});
  const std::uint16_t forest = bits({SemanticClass::kForest, SemanticClass::kTree});
  const auto stored = [](double weight) {
    return static_cast<std::uint8_t>(std::floor(weight * kGroundWeightMax + 0.5));
  };
  raster::Grid<std::uint8_t> result(semantics.geometry(), stored(weights.open));
  for (std::size_t i = 0; i < result.values().size(); ++i) {
    const std::uint16_t here = semantics.values()[i];
    if ((here & urban) != 0) {
      result.values()[i] = stored(weights.urban);
    } else if ((here & water) != 0) {
      result.values()[i] = stored(weights.water);
    } else if ((here & forest) != 0) {
      result.values()[i] = stored(weights.forest);
    }
  }
  return result;
}

}  // namespace hedgehop::preparation
