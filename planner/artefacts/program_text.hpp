// SPDX-License-Identifier: GPL-3.0-or-later
// Stage 9's artefact: the files of one program in one controller's language.
#pragma once

#include <string>
#include <vector>

#include "planner/artefacts/job.hpp"

namespace asbuilt {

struct ProgramFile {
  std::string name;   // file name without folder
  std::string bytes;
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("name", s.name), a("bytes", s.bytes);
  }
};

struct ProgramText {
  Language language = Language::krl;
  std::vector<ProgramFile> files;  // the main program first
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("language", s.language), a("files", s.files);
  }
};

}  // namespace asbuilt
