"""Pure: a site with its maps, plan and map jobs with their answers, and the planners of a site."""
