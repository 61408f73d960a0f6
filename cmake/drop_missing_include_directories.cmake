# Removes include directories that do not exist from imported targets.
#
# The ROS 2 wheels export targets whose INTERFACE_INCLUDE_DIRECTORIES name
# directories of the machine they were built on. CMake refuses to generate for
# such targets, although nothing needs the directories. Pass this file as
#
#   cmake -DCMAKE_PROJECT_INCLUDE=<path>/drop_missing_include_directories.cmake
#
# when building against the wheels (the Makefile does). A build on an ordinary
# ROS installation does not need it, and it changes nothing there.

cmake_minimum_required(VERSION 3.21)  # IMPORTED_TARGETS directory property

function(gda_drop_missing_include_directories directory)
  get_property(targets DIRECTORY "${directory}" PROPERTY IMPORTED_TARGETS)
  foreach(target IN LISTS targets)
    get_target_property(include_directories ${target} INTERFACE_INCLUDE_DIRECTORIES)
    if(NOT include_directories)
      continue()
    endif()
    set(existing "")
    set(missing "")
    foreach(include_directory IN LISTS include_directories)
      # Parts of generator expressions are evaluated later: leave them alone.
      if(include_directory MATCHES "[<>]" OR EXISTS "${include_directory}")
        list(APPEND existing "${include_directory}")
      else()
        list(APPEND missing "${include_directory}")
      endif()
    endforeach()
    if(missing)
      message(VERBOSE "${target}: dropped missing include directories: ${missing}")
      set_target_properties(${target} PROPERTIES
        INTERFACE_INCLUDE_DIRECTORIES "${existing}")
    endif()
  endforeach()

  get_property(subdirectories DIRECTORY "${directory}" PROPERTY SUBDIRECTORIES)
  foreach(subdirectory IN LISTS subdirectories)
    gda_drop_missing_include_directories("${subdirectory}")
  endforeach()
endfunction()

# CMAKE_PROJECT_INCLUDE is read after every project() call; once is enough.
if(CMAKE_CURRENT_SOURCE_DIR STREQUAL CMAKE_SOURCE_DIR)
  cmake_language(DEFER DIRECTORY "${CMAKE_SOURCE_DIR}"
    CALL gda_drop_missing_include_directories "${CMAKE_SOURCE_DIR}")
endif()
