// Filled by reports only.
function reportSide() {}
function reportTabs() { return []; }
async function reportData() {}
