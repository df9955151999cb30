"""Pure: plan jobs and their answers, and the planners of a site that answer them."""
