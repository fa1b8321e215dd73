// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/pipeline/frames.hpp"

#include "planner/base/hash.hpp"
#include "planner/io/depth_image.hpp"
#include "planner/io/file.hpp"

namespace asbuilt {

FrameSource frames_under(const std::filesystem::path& root) {
  return [root](const StreamFrame& frame) -> Result<DepthPixels> {
    const auto bytes = read_file(root / frame.file, frame.file);
    if (!bytes) return refuse_all(bytes.error());
    if (sha256_hex(*bytes) != frame.sha256)
      return refuse({.code = "fuse.frame_changed",
                     .where = frame.file,
                     .message = "The image is no longer the one that was there when the item was read; leave the files alone while a batch runs, and run it again.",
                     .stage = "fuse"});
    auto image = read_depth_image(*bytes, frame.file);
    if (!image) return refuse_all(image.error());
    return DepthPixels{image->width_px, image->height_px, std::move(image->depth_count)};
  };
}

}  // namespace asbuilt
