#include "output/png_image.hpp"

#include <array>
#include <cpl_vsi.h>
#include <gdal_priv.h>
#include <memory>

#include "base/errors.hpp"

namespace hedgehop::output {

std::string png_bytes(const Image& image) {
  GDALAllRegister();
  GDALDriver* memory = GetGDALDriverManager()->GetDriverByName("MEM");
  GDALDriver* png = GetGDALDriverManager()->GetDriverByName("PNG");
  if (memory == nullptr || png == nullptr) {
    throw SystemFailure("report: GDAL has no PNG driver", "install GDAL with its drivers");
  }
  const auto row_bytes = static_cast<std::size_t>(image.columns) * 3;
  std::string bytes;  // rows from the north
  bytes.reserve(image.bytes.size());
  for (int row = image.rows - 1; row >= 0; --row) {
    bytes.append(image.bytes, static_cast<std::size_t>(row) * row_bytes, row_bytes);
  }
  const std::unique_ptr<GDALDataset> plain(
      memory->Create("", image.columns, image.rows, 3, GDT_Byte, nullptr));
  std::array<int, 3> bands = {1, 2, 3};
  if (!plain || plain->RasterIO(GF_Write, 0, 0, image.columns, image.rows, bytes.data(),
                                image.columns, image.rows, GDT_Byte, 3, bands.data(), 3,
                                static_cast<GSpacing>(row_bytes), 1, nullptr) != CE_None) {
    throw SystemFailure("report: a picture cannot be kept in memory");
  }
  const std::string file =
      "/vsimem/hedgehop_png_" + std::to_string(reinterpret_cast<std::uintptr_t>(&bytes)) + ".png";
  {
    const std::unique_ptr<GDALDataset> packed(
        png->CreateCopy(file.c_str(), plain.get(), FALSE, nullptr, nullptr, nullptr));
    if (!packed) {
      throw SystemFailure("report: a picture cannot be packed as PNG");
    }
  }
  vsi_l_offset length = 0;
  const GByte* content = VSIGetMemFileBuffer(file.c_str(), &length, FALSE);
  std::string packed(reinterpret_cast<const char*>(content), static_cast<std::size_t>(length));
  VSIUnlink(file.c_str());
  VSIUnlink((file + ".aux.xml").c_str());
  return packed;
}

std::string base64(std::string_view bytes) {
  static constexpr char kDigits[] =
      "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string text;
  text.reserve((bytes.size() + 2) / 3 * 4);
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    std::uint32_t group = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      group = group << 8U | (i + k < bytes.size() ? static_cast<unsigned char>(bytes[i + k]) : 0U);
    }
    for (std::size_t k = 0; k < 4; ++k) {
      text += i + k <= bytes.size() ? kDigits[group >> (18U - 6U * k) & 63U] : '=';
    }
  }
  return text;
}

std::string png_data_url(const Image& image) {
  return "data:image/png;base64," + base64(png_bytes(image));
}

}  // namespace hedgehop::output
