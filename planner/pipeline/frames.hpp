// SPDX-License-Identifier: GPL-3.0-or-later
// The images of a job's streams, read when they are asked for: none is kept.
#pragma once

#include <filesystem>

#include "planner/fuse/streams.hpp"

namespace asbuilt {

/// Files relative to `root`, the batch's folder. Refuses input.file_missing, input.file_unreadable, input.depth_*, and
/// fuse.frame_changed where the bytes are no longer those the job was made from.
FrameSource frames_under(const std::filesystem::path& root);

}  // namespace asbuilt
