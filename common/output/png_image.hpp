#pragma once

#include <string>

#include "output/map_images.hpp"

namespace hedgehop::output {

/// An image as a PNG file, north up. Throws SystemFailure if GDAL cannot write it.
std::string png_bytes(const Image& image);

/// The same as a `data:` URL.
std::string png_data_url(const Image& image);

std::string base64(std::string_view bytes);

}  // namespace hedgehop::output
