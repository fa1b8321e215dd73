// SPDX-License-Identifier: GPL-3.0-or-later
// The files of an INFORM program: jobs with their position block and their lines, user frames, the controller's tools.
#pragma once

#include <array>
#include <map>
#include <string>
#include <vector>

#include "postprocessors/inform/inform.hpp"
#include "postprocessors/reading.hpp"

namespace asbuilt::inform {

struct Position {
  bool is_joint = false;
  std::array<double, 6> q_deg{};
  Pose<frame::Work, frame::Tool> T_work_tool;
  int user = -1;  // user frame number; -1: base
  int tool = 0;
  std::vector<bool> flags;  // RCONF
  int uses = 0;
  reading::Line line;
};
struct Job {
  std::string name;
  reading::Line head;
  std::map<std::string, Position> positions;
  std::vector<reading::Line> instructions;
  bool is_relative = false, has_frame = false;
  int frame_user = -1;
};

/// What the files hold; `first` is the job of the first .JBI file.
struct Jobs {
  std::map<std::string, Job> jobs;
  std::map<int, Pose<frame::Base, frame::Work>> user_frames;
  std::string first;
};

/// Throws what reading::guarded turns into a refusal.
Jobs load_jobs(const ProgramText& text, const PostContext& context);

/// A job's name at the scanner: capitals, digits, _ and -, at most 32.
std::string job_name(reading::Scanner& s);

}  // namespace asbuilt::inform
