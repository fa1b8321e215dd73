// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/io/depth_image.hpp"

#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include <zlib.h>

#include <cstring>

namespace asbuilt {
namespace {

std::uint32_t big_endian(std::string_view bytes, std::size_t at) {
  std::uint32_t v = 0;
  for (std::size_t i = 0; i < 4; ++i) v = v << 8 | static_cast<unsigned char>(bytes[at + i]);
  return v;
}

/// Chunks follow each other without a gap, each with its own checksum, up to IEND.
bool is_whole_png(std::string_view bytes) {
  std::size_t at = 8;
  while (at + 12 <= bytes.size()) {
    const std::size_t size = big_endian(bytes, at);
    if (size > bytes.size() - at - 12) return false;
    const auto sum = crc32(0, reinterpret_cast<const Bytef*>(bytes.data() + at + 4), static_cast<uInt>(size + 4));
    if (sum != big_endian(bytes, at + 8 + size)) return false;
    if (bytes.substr(at + 4, 4) == "IEND") return true;
    at += 12 + size;
  }
  return false;
}

}  // namespace

Result<DepthImage> read_depth_header(std::string_view bytes, const std::string& name) {
  const auto refused = [&](const char* code, const std::string& message, double measured = 0, double limit = 0) {
    return refuse({.code = code, .where = name, .message = message, .measured = measured, .limit = limit, .unit = limit > 0 ? "pixels" : "", .stage = "input"});
  };
  if (bytes.size() < 33 || !bytes.starts_with("\x89PNG\r\n\x1a\n") || bytes.substr(12, 4) != "IHDR")
    return refused("input.depth_format", "found no PNG, allowed 16-bit grey PNG images of depth");
  const std::uint32_t width = big_endian(bytes, 16), height = big_endian(bytes, 20);
  const int bits = static_cast<unsigned char>(bytes[24]), colour = static_cast<unsigned char>(bytes[25]);
  if (bits != 16 || colour != 0)
    return refused("input.depth_format", "found a PNG of " + std::to_string(bits) + " bits" + (colour == 0 ? ", grey" : ", coloured") +
                                             ", allowed 16 bits, grey: a depth image, not a picture of one");
  if (width == 0 || height == 0 || static_cast<double>(width) * height > 64e6)
    return refused("input.depth_size", "found an image of " + std::to_string(width) + " x " + std::to_string(height) + " pixels, allowed 64 million at most",
                   static_cast<double>(width) * height, 64e6);
  DepthImage image;
  image.width_px = static_cast<int>(width), image.height_px = static_cast<int>(height);
  return image;
}

Result<DepthImage> read_depth_image(std::string_view bytes, const std::string& name) {
  auto image = read_depth_header(bytes, name);
  if (!image) return image;
  cv::Mat decoded;
  const bool is_whole = is_whole_png(bytes);
  try {
    if (is_whole) decoded = cv::imdecode(cv::Mat(1, static_cast<int>(bytes.size()), CV_8UC1, const_cast<char*>(bytes.data())), cv::IMREAD_UNCHANGED);
  } catch (const cv::Exception&) {
  }
  if (decoded.empty() || decoded.type() != CV_16UC1 || decoded.cols != image->width_px || decoded.rows != image->height_px)
    return refuse({.code = "input.depth_broken", .where = name, .message = "found a PNG that ends early or is damaged; copy the frames again", .stage = "input"});
  image->depth_count.resize(static_cast<std::size_t>(image->width_px) * static_cast<std::size_t>(image->height_px));
  for (int y = 0; y < decoded.rows; ++y)
    std::memcpy(image->depth_count.data() + static_cast<std::size_t>(y) * static_cast<std::size_t>(decoded.cols), decoded.ptr(y), static_cast<std::size_t>(decoded.cols) * 2);
  return image;
}

std::string write_depth_png(const DepthImage& image) {
  const cv::Mat m(image.height_px, image.width_px, CV_16UC1, const_cast<std::uint16_t*>(image.depth_count.data()));
  std::vector<unsigned char> bytes;
  must(cv::imencode(".png", m, bytes, {cv::IMWRITE_PNG_COMPRESSION, 1}), "a depth image could not be written as PNG");
  return {bytes.begin(), bytes.end()};
}

}  // namespace asbuilt
