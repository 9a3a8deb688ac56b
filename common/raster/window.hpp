#pragma once

namespace hedgehop::raster {

/// A rectangle of cells, from its south-western one on.
struct Window {
  int column = 0;
  int row = 0;
  int columns = 0;
  int rows = 0;
};

}  // namespace hedgehop::raster
