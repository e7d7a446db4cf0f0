# Debian packages, one for each program, and the Python package: cmake --build build/release --target package
include(GNUInstallDirs)
set(lumifold_packages lumifold lumifold-server lumifold-worker lumifold-autoscale)
set(lumifold_services lumifold-server lumifold-worker lumifold-autoscale)
set(LUMIFOLD_PACKAGE_CONTACT "Lumifold <lumifold@localhost>" CACHE STRING "Who is responsible for Debian packages: NAME <ADDRESS>")
set(lumifold_scripts ${CMAKE_CURRENT_BINARY_DIR}/packages)

set(lumifold_target_lumifold lumifold_client)
set(lumifold_target_lumifold-server lumifold_server)
set(lumifold_target_lumifold-worker lumifold_worker)
set(lumifold_target_lumifold-autoscale lumifold_autoscale)

set(lumifold_description_lumifold "client of the Lumifold render farm
Renders glTF scenes by path tracing and filters only their noise, on this
machine or on a farm: submits jobs, shows their progress, downloads pictures.")
set(lumifold_description_lumifold-server "coordinator of the Lumifold render farm
Accepts jobs, gives their units to workers, merges what these render exactly
once, filters frames and serves pictures.")
set(lumifold_description_lumifold-worker "worker of the Lumifold render farm
Renders units of frames for a coordinator.")
set(lumifold_description_lumifold-autoscale "autoscaler of the Lumifold render farm
Asks Slurm for as many workers as the queue of a coordinator needs, within
limits, and lets idle ones go.")

# A package's program, documents (made by the program itself) and inventory of libraries.
foreach(package IN LISTS lumifold_packages)
  string(TOUPPER ${package} component)
  install(TARGETS ${lumifold_target_${package}} RUNTIME DESTINATION bin COMPONENT ${package})
  install(FILES ${CMAKE_CURRENT_LIST_DIR}/copyright DESTINATION share/doc/${package} COMPONENT ${package})
  install(CODE "execute_process(COMMAND \"${CMAKE_CURRENT_LIST_DIR}/documents.sh\" ${package} \"${CMAKE_RUNTIME_OUTPUT_DIRECTORY}\"
      \"\$ENV{DESTDIR}\${CMAKE_INSTALL_PREFIX}/share\" \"${LUMIFOLD_PACKAGE_CONTACT}\" COMMAND_ERROR_IS_FATAL ANY)"
    COMPONENT ${package})
  set(CPACK_DEBIAN_${component}_PACKAGE_NAME ${package})
  set(CPACK_DEBIAN_${component}_DESCRIPTION "${lumifold_description_${package}}")
endforeach()

# OpenCL's loader is looked for when the program runs.
set(CPACK_DEBIAN_LUMIFOLD_PACKAGE_SUGGESTS ocl-icd-libopencl1)

# A service's unit, options, and scripts that tell systemd. The coordinator begins to listen, on loopback,
# when it is installed; the others need to know a coordinator first.
foreach(package IN LISTS lumifold_services)
  string(TOUPPER ${package} component)
  install(FILES ${PROJECT_SOURCE_DIR}/deploy/systemd/${package}.service DESTINATION lib/systemd/system COMPONENT ${package})
  install(FILES ${CMAKE_CURRENT_LIST_DIR}/default/${package} DESTINATION /etc/default COMPONENT ${package})
  set(PACKAGE ${package})
  set(START_AT_ONCE false)
  if(package STREQUAL lumifold-server)
    set(START_AT_ONCE true)
  endif()
  foreach(script postinst prerm postrm)
    configure_file(${CMAKE_CURRENT_LIST_DIR}/scripts/${script}.in ${lumifold_scripts}/${package}/${script} @ONLY)
    file(CHMOD ${lumifold_scripts}/${package}/${script}
      PERMISSIONS OWNER_READ OWNER_WRITE OWNER_EXECUTE GROUP_READ GROUP_EXECUTE WORLD_READ WORLD_EXECUTE)
    list(APPEND CPACK_DEBIAN_${component}_PACKAGE_CONTROL_EXTRA ${lumifold_scripts}/${package}/${script})
  endforeach()
  file(WRITE ${lumifold_scripts}/${package}/conffiles "/etc/default/${package}\n")
  list(APPEND CPACK_DEBIAN_${component}_PACKAGE_CONTROL_EXTRA ${lumifold_scripts}/${package}/conffiles)
endforeach()

# The Python package, without a program: its users are scripts.
install(DIRECTORY ${PROJECT_BINARY_DIR}/client/python/lumifold DESTINATION lib/python3/dist-packages COMPONENT python3-lumifold
  FILES_MATCHING PATTERN "*.py" PATTERN "py.typed" PATTERN "__pycache__" EXCLUDE)
install(FILES ${CMAKE_CURRENT_LIST_DIR}/copyright DESTINATION share/doc/python3-lumifold COMPONENT python3-lumifold)
install(CODE "execute_process(COMMAND \"${CMAKE_CURRENT_LIST_DIR}/documents.sh\" python3-lumifold \"${CMAKE_RUNTIME_OUTPUT_DIRECTORY}\"
    \"\$ENV{DESTDIR}\${CMAKE_INSTALL_PREFIX}/share\" \"${LUMIFOLD_PACKAGE_CONTACT}\" COMMAND_ERROR_IS_FATAL ANY)"
  COMPONENT python3-lumifold)
set(CPACK_DEBIAN_PYTHON3-LUMIFOLD_PACKAGE_NAME python3-lumifold)
set(CPACK_DEBIAN_PYTHON3-LUMIFOLD_DESCRIPTION "Python package of the Lumifold render farm
Submits scenes to a farm from scripts, follows their jobs and saves pictures.")
set(CPACK_DEBIAN_PYTHON3-LUMIFOLD_PACKAGE_ARCHITECTURE all)
set(CPACK_DEBIAN_PYTHON3-LUMIFOLD_PACKAGE_SECTION python)
set(CPACK_DEBIAN_PYTHON3-LUMIFOLD_PACKAGE_SHLIBDEPS OFF)
set(CPACK_DEBIAN_PYTHON3-LUMIFOLD_PACKAGE_DEPENDS "python3:any, python3-grpcio, python3-protobuf, python3-xxhash")

# What scripts in other languages need comes with the client.
install(DIRECTORY ${PROJECT_SOURCE_DIR}/proto/lumifold DESTINATION share/lumifold/proto COMPONENT lumifold FILES_MATCHING PATTERN "*.proto")
install(DIRECTORY ${PROJECT_SOURCE_DIR}/docs/schemas DESTINATION share/lumifold COMPONENT lumifold)
install(DIRECTORY ${PROJECT_SOURCE_DIR}/docs/examples DESTINATION share/doc/lumifold COMPONENT lumifold PATTERN "__pycache__" EXCLUDE)

set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY "")  # each package has its own
set(CPACK_COMPONENTS_ALL ${lumifold_packages} python3-lumifold)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_STRIP_FILES ON)
set(CPACK_PACKAGE_CONTACT "${LUMIFOLD_PACKAGE_CONTACT}")
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_RELEASE 1)
set(CPACK_DEBIAN_PACKAGE_SECTION graphics)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_PACKAGE_CONTROL_STRICT_PERMISSION ON)
include(CPack)
