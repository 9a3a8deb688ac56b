#pragma once

#include <string>

#include "output/map_images.hpp"
#include "output/report_charts.hpp"
#include "output/report_page.hpp"

namespace hedgehop::output {

/// Where a place of the map lies in the drawing: 1000 units wide, y down.
struct DrawingFrame {
  MapWindow window;

  [[nodiscard]] double height() const { return 1000.0 * window.height_m() / window.width_m(); }
  [[nodiscard]] double x(double x_m) const {
    return 1000.0 * (x_m - window.west_m) / window.width_m();
  }
  [[nodiscard]] double y(double y_m) const {
    return 1000.0 * (window.north_m - y_m) / window.width_m();
  }
};
DrawingFrame drawing_frame(const ReportContent& content);

/// The map as one drawing, its layers to be switched without a script, and their legends.
std::string report_map(const ReportContent& content, const DrawingFrame& frame);

}  // namespace hedgehop::output
