#include "geo/gdal_guards.hpp"

#include <cpl_conv.h>
#include <cpl_error.h>
#include <cpl_vsi.h>
#include <cstdint>
#include <gdal_priv.h>

#include "base/errors.hpp"

namespace hedgehop::geo {
namespace {

void CPL_STDCALL on_error(CPLErr severity, CPLErrorNum, const char* text) {
  if (severity >= CE_Failure) {
    static_cast<GdalErrors*>(CPLGetErrorHandlerUserData())->note(text);
  }
}

}  // namespace

void DatasetCloser::operator()(GDALDataset* dataset) const { GDALClose(dataset); }

GdalErrors::GdalErrors() { CPLPushErrorHandlerEx(&on_error, this); }

GdalErrors::~GdalErrors() { CPLPopErrorHandler(); }

void GdalErrors::note(const char* text) {
  if (first_.empty()) {
    first_ = text;
  }
}

GdalSetting::GdalSetting(const char* key, const char* value) : key_(key) {
  if (const char* before = CPLGetThreadLocalConfigOption(key, nullptr)) {
    before_ = before;
  }
  CPLSetThreadLocalConfigOption(key, value);
}

GdalSetting::~GdalSetting() {
  CPLSetThreadLocalConfigOption(key_, before_ ? before_->c_str() : nullptr);
}

MemoryFile::MemoryFile(const std::string& name)
    : folder_("/vsimem/hedgehop_" + std::to_string(reinterpret_cast<std::uintptr_t>(this))),
      path_(folder_ + "/" + name) {}

MemoryFile::~MemoryFile() { VSIRmdirRecursive(folder_.c_str()); }

ByteView MemoryFile::bytes() const {
  vsi_l_offset size = 0;
  const GByte* data = VSIGetMemFileBuffer(path_.c_str(), &size, FALSE);
  HEDGEHOP_ASSERT(data != nullptr);
  return std::as_bytes(std::span<const GByte>(data, static_cast<std::size_t>(size)));
}

}  // namespace hedgehop::geo
