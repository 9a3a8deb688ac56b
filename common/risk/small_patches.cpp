#include "risk/small_patches.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>
#include <vector>

namespace hedgehop::risk {
namespace {

// The kernels of all directions: rows of cells along x, y, the diagonals, and the lines of slope
// 1/2 and 2, which have two forms each, by the cell they begin with. The set is closed under
// quarter turns and reflections, so the result turns and mirrors with the map.
std::vector<cv::Mat> rows_of_cells(double length_cells) {
  std::vector<cv::Mat> kernels;
  // Minor steps in units of half a cell for each cell along the major axis.
  const auto add = [&](int halves, int first) {
    const double step = std::sqrt(1.0 + 0.25 * halves * halves);
    const int count = static_cast<int>(std::ceil(length_cells / step));
    const int size = 2 * count - 1;  // odd, so that it turns about its middle
    cv::Mat kernel = cv::Mat::zeros(size, size, CV_8U);
    for (int i = 0; i < count; ++i) {
      kernel.at<unsigned char>(count - 1 + (halves * i + first) / 2, count - 1 + i) = 1;
    }
    kernels.push_back(kernel);
    kernels.push_back(kernel.t());
    if (halves != 0) {
      cv::Mat mirrored;
      cv::flip(kernel, mirrored, 0);
      kernels.push_back(mirrored);
      cv::Mat turned = mirrored.t();
      kernels.push_back(turned);
    }
  };
  add(0, 0);
  add(2, 0);
  add(1, 0);
  add(1, 1);
  return kernels;
}

}  // namespace

raster::Grid<float> without_small_patches(const raster::Grid<float>& visibility, double patch_m) {
  const double length_cells = patch_m / visibility.geometry().cell_m;
  if (!(length_cells >= 2.0) || length_cells > std::min(visibility.columns(), visibility.rows())) {
    return visibility;
  }
  raster::Grid<float> input = visibility;
  raster::Grid<float> result = visibility;
  const cv::Mat image(input.rows(), input.columns(), CV_32F, input.values().data());
  cv::Mat least(result.rows(), result.columns(), CV_32F, result.values().data());
  constexpr float kBright = std::numeric_limits<float>::max();
  least.setTo(kBright);
  cv::Mat greatest;
  cv::Mat closed;
  cv::Mat reflected;
  const cv::Point middle(-1, -1);
  for (const cv::Mat& kernel : rows_of_cells(length_cells)) {
    // The greatest value of the row that begins at each cell, then the least of the rows that hold
    // a cell. Beyond the border all is bright, so that rows lie inside the map.
    cv::dilate(image, greatest, kernel, middle, 1, cv::BORDER_CONSTANT, cv::Scalar::all(kBright));
    cv::flip(kernel, reflected, -1);
    cv::erode(greatest, closed, reflected, middle, 1, cv::BORDER_CONSTANT,
              cv::Scalar::all(kBright));
    cv::min(least, closed, least);
  }
  return result;
}

}  // namespace hedgehop::risk
