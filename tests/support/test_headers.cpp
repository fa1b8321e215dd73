// SPDX-License-Identifier: GPL-3.0-or-later
// Nothing but the precompiled headers that the tests share (tests/CMakeLists.txt).
